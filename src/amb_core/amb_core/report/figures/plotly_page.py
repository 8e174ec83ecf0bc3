"""Draws a chart with plotly: to zoom in, and to read values by pointing at them."""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

import numpy as np

from amb_core.ground.extras import extra
from amb_core.report.figures.drawing import (
    Axis,
    Band,
    Curve,
    Drawing,
    Heat,
    HoverGrid,
    Note,
    Points,
    Rule,
    Span,
    Values,
    log_marks,
)
from amb_core.report.figures.style import OPACITY, Stroke

with extra("figures"):
    import plotly.graph_objects as go  # type: ignore[import-untyped]
    from plotly.subplots import make_subplots  # type: ignore[import-untyped]

PIXELS_PER_INCH = 100
TITLE_HEIGHT, TICKS_HEIGHT, AXIS_HEIGHT = 35, 15, 75  # pixels of a panel's title, and of an axis without and with label
COLUMN_PIXELS = 384  # of a panel beside others; narrower windows scroll
PAPER_PIXELS = 335  # likewise on paper, two beside each other
LABELS_WIDTH = 95  # pixels of an axis's numbers and title
LEFT, RIGHT = 70, 15  # margins (pixels)
PANEL_TITLE = 13  # pixels
TITLE_DISTANCE = 8  # pixels from an axis's labels to its title, which overlap without
MARKERS = {"circle": "circle", "square": "square", "diamond": "diamond", "triangle": "triangle-up", "cross": "x-thin"}
TEXT = "#767676"  # readable on white and on black alike, where no style sheet gives texts the page's colour
GRID = "rgba(128, 128, 128, 0.25)"


def draw_page(chart: Drawing) -> go.Figure:
    """Draw a chart as a plotly figure.

    Its `layout.meta` has `alt`, the text for those who cannot see it, `table`, its main numbers, and the number of
    `columns`: `page_fragment` puts them into the HTML.
    """
    page = make_subplots(
        rows=chart.rows,
        cols=chart.columns,
        shared_xaxes="columns" if chart.shared_x else False,
        subplot_titles=[panel.title for panel in chart.panels] if any(panel.title for panel in chart.panels) else None,
        vertical_spacing=_gap(chart),
        horizontal_spacing=_gap_of_columns(chart),
    )
    shown: set[str] = set()
    for number in range(len(chart.panels)):
        _draw_panel(chart, number, page)
    for trace in page.data:  # one entry for what several panels show
        trace.update(showlegend=bool(trace.name) and trace.name not in shown, legendgroup=trace.name)
        shown.add(trace.name)
    page.update_annotations(font_size=PANEL_TITLE)
    table = chart.table and {"header": chart.table.header, "rows": chart.table.rows}
    page.update_layout(
        title={"text": chart.title},
        meta={"alt": chart.alt, "table": table, "columns": chart.columns},
        template="none",
        height=PIXELS_PER_INCH * chart.size[1] + 60,
        margin={"l": LEFT, "r": RIGHT, "t": 50, "b": 90 if any(panel.equal for panel in chart.panels) else 60},
        font={"size": 14, "color": TEXT},
        legend={"orientation": "h", "yref": "container", "yanchor": "bottom", "y": 0, "x": 0},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        hovermode="closest",
    )
    return page


def _draw_panel(chart: Drawing, number: int, page: go.Figure) -> None:
    """Draw a panel of a chart, by its number, into its place on the page."""
    panel = chart.panels[number]
    row, column = divmod(number, chart.columns)
    place = {"row": row + 1, "col": column + 1}
    gridded = any(isinstance(item, HoverGrid) for item in panel.items)
    for item in panel.items:
        draw(item, page, place)
        if gridded and isinstance(item, Curve) and not item.hover:
            page.data[-1].hoverinfo = "skip"  # the grid below shows more, with units
    lowest = number + chart.columns >= len(chart.panels)
    page.update_xaxes(**_axis(panel.x, panel.reach("x"), lowest or not chart.shared_x), **place)
    page.update_yaxes(**_axis(panel.y, panel.reach("y"), True), **place)
    if panel.equal:
        # margins that follow the labels and axes that follow each other never come to rest
        page.update_xaxes(automargin=False, **place)
        page.update_yaxes(scaleanchor=f"x{number + 1 if number else ''}", automargin=False, **place)


def _gap(chart: Drawing) -> float:
    """Space between rows of panels, for a title and the axis above, as a share of the height."""
    title = TITLE_HEIGHT if any(panel.title for panel in chart.panels) else 0
    axis = TICKS_HEIGHT if chart.shared_x else AXIS_HEIGHT
    free = PIXELS_PER_INCH * chart.size[1]
    return float(min((title + axis) / free, 0.5 / chart.rows))


def _gap_of_columns(chart: Drawing) -> float | None:
    """Space between columns for the labels of an axis where the page is narrowest, as a share of the width."""
    if chart.columns == 1:
        return None
    return LABELS_WIDTH / (PAPER_PIXELS * chart.columns - LEFT - RIGHT)


def _axis(axis: Axis, reach: tuple[float, float], labelled: bool) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "title": {"text": axis.label if labelled else None, "standoff": TITLE_DISTANCE},
        "gridcolor": GRID,
        "zeroline": False,
        "showline": True,
        "linecolor": TEXT,
        "ticks": "outside",
        "tickcolor": TEXT,
        "automargin": True,
    }
    if axis.log:
        marks = log_marks(*reach)
        settings |= {"type": "log", "tickvals": marks, "ticktext": [f"{mark:g}" for mark in marks]}
    if axis.limits:
        settings["range"] = [math.log10(end) for end in axis.limits] if axis.log else list(axis.limits)
    return settings


@singledispatch
def draw(item: object, page: go.Figure, place: dict[str, int]) -> None:
    """Draw an item of a chart into the subplot at a place (row and column)."""
    raise TypeError(f"charts hold no {type(item).__name__}")


@draw.register
def _(item: Curve, page: go.Figure, place: dict[str, int]) -> None:
    page.add_scatter(
        x=_short(item.x),
        y=_short(item.y),
        mode="lines",
        name=item.label,
        line=_line(item.stroke),
        **({} if item.stroke.opacity == 1.0 else {"opacity": item.stroke.opacity}),
        **_hover(item),
        **place,
    )


@draw.register
def _(item: Points, page: go.Figure, place: dict[str, int]) -> None:
    symbol = MARKERS[item.marker] + ("" if item.filled or item.marker == "cross" else "-open")
    marker = {"color": item.colour, "symbol": symbol, "size": 9, "line": {"color": item.colour, "width": 1.5}}
    page.add_scatter(
        x=_short(item.x), y=_short(item.y), mode="markers", name=item.label, marker=marker, **_hover(item), **place
    )


@draw.register
def _(item: Band, page: go.Figure, place: dict[str, int]) -> None:
    page.add_scatter(
        x=_short(np.concatenate([item.x, item.x[::-1]])),
        y=_short(np.concatenate([item.high, item.low[::-1]])),
        mode="lines",
        line={"width": 0},
        fill="toself",
        name=item.label,
        hoverinfo="skip",
        **_area(item),
        **place,
    )


@draw.register
def _(item: Span, page: go.Figure, place: dict[str, int]) -> None:
    letter = {"annotation_text": f"<b>{item.letter}</b>", "annotation_position": "top"} if item.letter else {}
    page.add_vrect(
        x0=item.start,
        x1=item.stop,
        fillcolor=item.colour,
        opacity=OPACITY,
        line_width=0,
        layer="below",
        **letter,
        exclude_empty_subplots=False,
        **place,
    )
    # a shape has no place in the legend
    swatch = {"symbol": "square", "size": 14, "color": item.colour, "opacity": 2 * OPACITY}
    page.add_scatter(x=[None], y=[None], mode="markers", name=item.label, marker=swatch, **place)


@draw.register
def _(item: Rule, page: go.Figure, place: dict[str, int]) -> None:
    page.add_vline(x=item.x, line=_line(item.stroke), exclude_empty_subplots=False, **place)
    page.add_scatter(x=[None], y=[None], mode="lines", name=item.label, line=_line(item.stroke), **place)


@draw.register
def _(item: Note, page: go.Figure, place: dict[str, int]) -> None:
    page.add_scatter(
        x=[item.x], y=[item.y], mode="text", text=[f"<b>{item.text}</b>"], hoverinfo="skip", showlegend=False, **place
    )


@draw.register
def _(item: Heat, page: go.Figure, place: dict[str, int]) -> None:
    page.add_heatmap(
        x=_short(item.x),
        y=_short(item.y),
        z=_short(np.log10(item.values)),
        customdata=_short(item.values),
        hovertemplate=f"%{{x:.4g}}, %{{y:.4g}}: %{{customdata:.3g}} {item.unit}<extra></extra>",
        hoverongaps=False,
        coloraxis="coloraxis",
        **place,
    )
    low, high = (math.log10(end) for end in item.limits)
    powers = list(range(math.ceil(low), math.floor(high) + 1))
    page.update_layout(
        coloraxis={
            "cmin": low,
            "cmax": high,
            "colorscale": "Cividis",
            "colorbar": {
                "title": {"text": f"{item.label} ({item.unit})", "side": "right"},
                "tickvals": powers,
                "ticktext": [f"{10.0**power:g}" for power in powers],
                "thickness": 15,
            },
        }
    )


@draw.register
def _(item: HoverGrid, page: go.Figure, place: dict[str, int]) -> None:
    for number, name in enumerate(item.names):  # an invisible layer for each
        here = item.number == number
        if here.any():
            page.add_heatmap(
                x=_short(item.x),
                y=_short(item.y),
                z=_short(np.where(here, 0.0, np.nan)),
                hovertemplate=f"%{{x:.4~g}} {item.units[0]}, %{{y:.4~g}} {item.units[1]}: {name}<extra></extra>",
                hoverongaps=False,
                opacity=0.0,
                showscale=False,
                **place,
            )


def _short(values: Values) -> Values:
    """In single precision: seven digits are more than a screen shows, and half the size of the page."""
    limit = float(np.finfo(np.float32).max)
    return np.asarray(np.clip(values, -limit, limit), dtype=np.float32)


def _hover(item: Curve | Points) -> dict[str, Any]:
    if not item.hover:
        return {}
    return {"text": item.hover, "hovertemplate": "%{text}<extra></extra>"}


def _line(stroke: Stroke) -> dict[str, Any]:
    return {"color": stroke.colour, "dash": stroke.dash, "width": stroke.width}


def _area(item: Band) -> dict[str, Any]:
    red, green, blue = (int(item.colour[start : start + 2], 16) for start in (1, 3, 5))
    light = f"rgba({red}, {green}, {blue}, {OPACITY * item.opacity:g})"
    if not item.hatch:
        return {"fillcolor": light}
    return {"fillpattern": {"shape": item.hatch, "bgcolor": light, "fgcolor": item.colour, "fgopacity": 0.4, "size": 8}}
