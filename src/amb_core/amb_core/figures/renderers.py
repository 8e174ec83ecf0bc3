"""From what makes a chart to the pair of functions that draw it, by matplotlib and by plotly."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, ParamSpec

from amb_core.figures.chart import Chart
from amb_core.figures.matplotlib_figure import draw_figure
from amb_core.figures.plotly_page import draw_page

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]
    from matplotlib.figure import Figure

P = ParamSpec("P")


def renderers(chart: Callable[P, Chart]) -> tuple[Callable[P, Figure], Callable[P, go.Figure]]:
    """Functions with the parameters of one that makes a chart: the first returns its figure, the second its page."""

    @wraps(chart)
    def figure(*args: P.args, **kwargs: P.kwargs) -> Figure:
        return draw_figure(chart(*args, **kwargs))

    @wraps(chart)
    def page(*args: P.args, **kwargs: P.kwargs) -> go.Figure:
        return draw_page(chart(*args, **kwargs))

    return figure, page
