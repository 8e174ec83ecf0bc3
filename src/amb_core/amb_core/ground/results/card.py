"""Results in notebooks: a line as `repr`, and a card with that line, a table and a chart."""

from __future__ import annotations

import base64
import sys
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

from amb_core.ground.errors import AmbError


class Result:
    """A result that shows itself: one line as `repr`, and a card in a notebook with the line, a table and a chart.

    Subclasses have `summary`. Dataclasses need `repr=False`.
    """

    _chart_of: Callable[[object], Any] | None = None

    @property
    def summary(self) -> str:
        """One line of text, the verdict first where there is one.

        Raises
        ------
        NotImplementedError
            If the kind of result has no summary.
        """
        raise NotImplementedError

    @property
    def rows(self) -> Sequence[tuple[str, str]]:
        """The table: what, and its value."""
        return ()

    @staticmethod
    def draw_with(chart_of: Callable[[object], Any]) -> None:
        """Take a function that makes the chart of a result; it raises AmbError where there is none.

        Parameters
        ----------
        chart_of : callable
            Takes a result and returns its chart; raises AmbError if the result has none.
        """
        Result._chart_of = staticmethod(chart_of)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {' '.join(self.summary.split())}>"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{escape(what)}</th><td>{escape(value)}</td></tr>" for what, value in self.rows)
        return f"<div><p><strong>{escape(self.summary)}</strong></p><table>{rows}</table>{self._image()}</div>"

    def _image(self) -> str:
        """The chart as HTML; empty where there is none."""
        try:
            # The room that draws lies above this one, and may be missing; the package finds it, and it calls draw_with.
            _ = sys.modules[__name__.partition(".")[0]].plot
            chart = None if Result._chart_of is None else Result._chart_of(self)
        except (ImportError, AmbError):
            chart = None
        if chart is None:
            return ""
        data = base64.b64encode(chart._repr_png_()).decode()
        return f'<img alt="{escape(chart.title)}" style="max-width: 100%" src="data:image/png;base64,{data}">'


def rows_by_axis(values: Mapping[str, Mapping[str, float | None]]) -> list[tuple[str, str]]:
    """The rows of a table of numbers by axis and name.

    Parameters
    ----------
    values : mapping of str to mapping of str to float or None
        Numbers by axis and name, None for missing ones; the names end in the units of their values.

    Returns
    -------
    list of (str, str)
        What the number is, and its text; - for a missing one.
    """
    every = (
        (f"{axis}, {name.replace('_', ' ')}", value) for axis, part in values.items() for name, value in part.items()
    )
    return [(what, "-" if value is None else f"{value:.3g}") for what, value in every]
