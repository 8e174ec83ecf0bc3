"""Draws a chart with matplotlib, without pyplot: no display is needed and no state is left behind."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from amb_core.ground.extras import extra
from amb_core.ground.plain_text import plain_text
from amb_core.report.figures.drawing import (
    Band,
    Curve,
    Drawing,
    Heat,
    HoverGrid,
    Note,
    Panel,
    Points,
    Rule,
    Span,
    log_factors,
)
from amb_core.report.figures.style import OPACITY, Stroke

with extra("figures"):
    from matplotlib import ticker
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis as DrawnAxis
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LogNorm, to_rgba
    from matplotlib.figure import Figure

NARROW = 0.04  # share of a panel in which a letter has no room
LETTER_WIDTH = 0.066  # of the legend's font (inch)
LEGEND_PAD = 0.2  # between legend and edge of the figure, relative to its font
DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle": "^", "cross": "x"}


def draw_figure(chart: Drawing) -> Figure:
    """Draw a chart; save the figure with `savefig`."""
    figure = Figure(figsize=chart.size, layout="constrained", dpi=150)
    grid = figure.subplots(chart.rows, chart.columns, sharex="col" if chart.shared_x else "none", squeeze=False)
    entries: dict[str, Any] = {}
    for number, axes in enumerate(grid.flat):
        if number >= len(chart.panels):
            axes.remove()
            continue
        panel = chart.panels[number]
        lowest = number + chart.columns >= len(chart.panels)
        _prepare(axes, panel, labelled=lowest or not chart.shared_x)
        for item in panel.items:
            draw(item, axes)
        # last, so that nothing drawn changes them
        if panel.x.limits:
            axes.set_xlim(*panel.x.limits)
        if panel.y.limits:
            axes.set_ylim(*panel.y.limits)
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.suptitle(_literal(chart.title), fontsize=12, wrap=True)
    if entries:
        _draw_legend(figure, entries)
    return figure


def _draw_legend(figure: Figure, entries: dict[str, Any]) -> None:
    """Below the panels, which leave it room; Matplotlib does so by itself from version 3.7, stock Jazzy has 3.6."""
    fitting = figure.get_figwidth() / (LETTER_WIDTH * (6 + max(map(len, entries))))
    legend = figure.legend(
        entries.values(),
        map(_literal, entries),
        loc="lower center",
        ncols=max(1, min(4, int(fitting))),
        fontsize=9,
        frameon=False,
        borderaxespad=LEGEND_PAD,
    )
    drawn = legend.get_window_extent(FigureCanvasAgg(figure).get_renderer())
    share = drawn.y1 / figure.bbox.height
    figure.set_layout_engine("constrained", rect=(0.0, share, 1.0, 1.0 - share))


def _literal(text: str) -> str:
    """A text as it is: what is between dollar signs would be a formula, or an error."""
    return plain_text(text).replace("$", r"\$")


def _prepare(axes: Axes, panel: Panel, labelled: bool) -> None:
    axes.set_xlabel(_literal(panel.x.label) if labelled else "")
    axes.set_ylabel(_literal(panel.y.label))
    if panel.title:
        axes.set_title(_literal(panel.title), fontsize=10)
    if panel.x.log:
        axes.set_xscale("log")
        _number_logarithmic(axes.xaxis, panel.reach("x"))
    if panel.y.log:
        axes.set_yscale("log")
        _number_logarithmic(axes.yaxis, panel.reach("y"))
    axes.grid(True, alpha=0.3, linewidth=0.6)
    if panel.equal:
        # With limits of its own, a panel adjusts its box to them; Matplotlib would drop the limits, with a warning.
        axes.set_aspect("equal", adjustable="box" if panel.x.limits and panel.y.limits else "datalim")


def _number_logarithmic(drawn: DrawnAxis, reach: tuple[float, float]) -> None:
    """Plain numbers instead of powers of ten."""
    drawn.set_major_locator(ticker.LogLocator(subs=log_factors(*reach)))
    drawn.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    drawn.set_minor_formatter(ticker.NullFormatter())


@singledispatch
def draw(item: object, axes: Axes) -> None:
    """Draw an item of a chart into axes."""
    raise TypeError(f"charts hold no {type(item).__name__}")


@draw.register
def _(item: Curve, axes: Axes) -> None:
    axes.plot(item.x, item.y, label=item.label, **_line(item.stroke))


@draw.register
def _(item: Points, axes: Axes) -> None:
    face = item.colour if item.filled else "none"
    axes.plot(
        item.x,
        item.y,
        label=item.label,
        linestyle="none",
        marker=MARKERS[item.marker],
        markersize=5,
        color=item.colour,
        markerfacecolor=face,
        zorder=3,
    )


@draw.register
def _(item: Band, axes: Axes) -> None:
    axes.fill_between(item.x, item.low, item.high, label=item.label, **_area(item))


@draw.register
def _(item: Span, axes: Axes) -> None:
    axes.axvspan(item.start, item.stop, label=item.label, zorder=0.5, **_area(item))
    low, high = axes.get_xlim()
    start, stop = max(item.start, low), min(item.stop, high)
    if item.letter and stop - start > NARROW * (high - low):
        axes.text(
            0.5 * (start + stop),
            0.98,
            item.letter,
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize=12,
            fontweight="bold",
        )


@draw.register
def _(item: Rule, axes: Axes) -> None:
    axes.axvline(item.x, label=item.label, **_line(item.stroke))


@draw.register
def _(item: Note, axes: Axes) -> None:
    axes.text(item.x, item.y, item.text, ha="center", va="center", fontsize=11, fontweight="bold", clip_on=True)


@draw.register
def _(item: Heat, axes: Axes) -> None:
    scale = LogNorm(*item.limits)
    mesh = axes.pcolormesh(item.x, item.y, item.values, cmap="cividis", norm=scale, shading="nearest", rasterized=True)
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    bar = figure.colorbar(mesh, ax=axes, label=f"{item.label} ({item.unit})", format="%g")
    bar.ax.yaxis.set_minor_formatter(ticker.NullFormatter())


@draw.register
def _(item: HoverGrid, axes: Axes) -> None:
    """Nothing: a figure on paper cannot be pointed at."""


def _line(stroke: Stroke) -> dict[str, Any]:
    return {
        "color": stroke.colour,
        "linestyle": DASHES[stroke.dash],
        "linewidth": stroke.width,
        **({} if stroke.opacity == 1.0 else {"alpha": stroke.opacity}),
    }


def _area(item: Band | Span) -> dict[str, Any]:
    """Look of an area: light enough for what is drawn over it, its hatch a little stronger."""
    opacity = item.opacity if isinstance(item, Band) else 1.0
    return {
        "facecolor": to_rgba(item.colour, opacity * OPACITY),
        "edgecolor": to_rgba(item.colour, opacity * 0.45),
        "hatch": item.hatch,
        **({"hatch_linewidth": 0.6} if hasattr(PolyCollection, "set_hatch_linewidth") else {}),  # not in old ones
        "linewidth": 0.0,
    }
