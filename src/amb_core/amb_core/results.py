"""Results as plain values for strict JSON, the one way from a result to a file or a message, and as cards of notebooks.

Values are in SI units and in full; names of percentages and decibels end so. A number that does not exist is None.
"""

from __future__ import annotations

import base64
import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from html import escape
from pathlib import PurePath
from typing import Any

import numpy as np

from amb_core.errors import AmbError

VERSION = 2
"""Version of the names and units of files of results; they begin with it. Before there was none."""


class Result:
    """A result that shows itself: one line as `repr`, and a card in a notebook with the line, a table and a chart.

    Subclasses have `summary`. Dataclasses need `repr=False`.
    """

    _chart_of: Callable[[object], Any] | None = None

    @property
    def summary(self) -> str:
        """One line of text, the verdict first where there is one."""
        raise NotImplementedError

    @property
    def rows(self) -> Sequence[tuple[str, str]]:
        """The table: what, and its value."""
        return ()

    @staticmethod
    def draw_with(chart_of: Callable[[object], Any]) -> None:
        """Take a function that makes the chart of a result; it raises AmbError where there is none."""
        Result._chart_of = staticmethod(chart_of)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {' '.join(self.summary.split())}>"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{escape(what)}</th><td>{escape(value)}</td></tr>" for what, value in self.rows)
        return f"<div><p><strong>{escape(self.summary)}</strong></p><table>{rows}</table>{self._image()}</div>"

    def _image(self) -> str:
        """The chart as HTML; empty where there is none."""
        try:
            importlib.import_module(
                "amb_core.figures"
            )  # the room above draws, and only for notebooks; it may be missing
            chart = None if Result._chart_of is None else Result._chart_of(self)
        except (ImportError, AmbError):
            chart = None
        if chart is None:
            return ""
        data = base64.b64encode(chart._repr_png_()).decode()
        return f'<img alt="{escape(chart.title)}" style="max-width: 100%" src="data:image/png;base64,{data}">'


def rows_by_axis(values: Mapping[str, Mapping[str, float | None]]) -> list[tuple[str, str]]:
    """The rows of a table of numbers by axis and name."""
    every = (
        (f"{axis}, {name.replace('_', ' ')}", value) for axis, part in values.items() for name, value in part.items()
    )
    return [(what, "-" if value is None else f"{value:.3g}") for what, value in every]


def plain(value: Any) -> Any:
    """A value as JSON has it.

    Parameters
    ----------
    value : object
        Numbers, texts, None, arrays, enumerations (their names), paths, dataclasses, parameters, and mappings and
        sequences of these. A complex number becomes [real, imaginary]; NaN and infinity become None.

    Raises
    ------
    TypeError
        If a part is something else.
    """
    if isinstance(value, Mapping):
        return {str(plain(name)): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    return plain(value.model_dump()) if hasattr(value, "model_dump") else _scalar(value)


def _scalar(value: Any) -> Any:
    if isinstance(value, Enum) and not isinstance(value, str):
        return value.name
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return [_scalar(value.real), _scalar(value.imag)]
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"{type(value).__name__} is not a plain value")
