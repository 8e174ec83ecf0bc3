"""What a figure shows, described once: panels with axes, and the lines, points and areas in them.

The modules of the subjects (loop, sweep, region_map ...) describe results this way; `draw_figure` makes a matplotlib
figure of the description and `draw_page` an interactive one with plotly, so that both show the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.report.figures.style import Hatch, Marker, Stroke

Values = NDArray[Any]

WIDE = 3000.0  # ratio of the ends of a logarithmic axis above which only powers of ten are numbered
NARROW = 4.0  # likewise, below which every digit is
SINGLE = 1.1  # ratio to a single value of the ends of an axis that shows nothing else


@dataclass(frozen=True)
class Curve:
    """A line through points; NaN interrupts it. Without a label it is not in the legend; `hover` is as for points."""

    x: Values
    y: Values
    label: str
    stroke: Stroke
    hover: tuple[str, ...] = ()


@dataclass(frozen=True)
class Points:
    """Points on their own; `hover` has a text per point for the page."""

    x: Values
    y: Values
    label: str
    colour: str
    marker: Marker
    filled: bool = True
    hover: tuple[str, ...] = ()


@dataclass(frozen=True)
class Band:
    """The area between two curves over the same x; `opacity` is relative to that of other areas."""

    x: Values
    low: Values
    high: Values
    label: str
    colour: str
    hatch: Hatch = ""
    opacity: float = 1.0


@dataclass(frozen=True)
class Span:
    """All of a panel between two values of x, with a letter at the top where it is wide enough."""

    start: float
    stop: float
    label: str
    colour: str
    hatch: Hatch = ""
    letter: str = ""


@dataclass(frozen=True)
class Rule:
    """A vertical line through a panel."""

    x: float
    label: str
    stroke: Stroke


@dataclass(frozen=True)
class Note:
    """A short text in a panel, centred at a point."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Heat:
    """Positive values on a grid as colours on a logarithmic scale; NaN is left blank.

    `values` has a row for each y; `limits` are the ends of the scale, which all panels of a chart share; `label` and
    `unit` say what the colours mean.
    """

    x: Values
    y: Values
    values: Values
    limits: tuple[float, float]
    label: str
    unit: str


@dataclass(frozen=True)
class HoverGrid:
    """What the page shows for a place of a grid under the pointer: x, y and a name. Figures omit it.

    `number` has a row for each y, and the place of each name in `names`; `units` are those of x and y.
    """

    x: Values
    y: Values
    number: Values
    names: tuple[str, ...]
    units: tuple[str, str]


Item = Curve | Points | Band | Span | Rule | Note | Heat | HoverGrid


@dataclass(frozen=True)
class Axis:
    """An axis: its label with the unit, whether it is logarithmic, and its ends (None: from the data).

    Ends that are equal, as of a single speed or frequency, are moved apart; no axis can be drawn between them.
    """

    label: str
    log: bool = False
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.limits is not None and self.limits[0] == self.limits[1]:
            object.__setattr__(self, "limits", _apart(self.limits[0], self.log))


@dataclass(frozen=True)
class Panel:
    """Two axes and what is drawn over them, the first item lowest. `equal`: one scale for both axes."""

    x: Axis
    y: Axis
    items: tuple[Item, ...]
    title: str = ""
    equal: bool = False

    def reach(self, direction: Literal["x", "y"]) -> tuple[float, float]:
        """Ends of an axis: its limits, else the least and the largest value that it shows.

        Of a logarithmic axis these are positive; 1 to 10 where nothing is shown.
        """
        axis: Axis = getattr(self, direction)
        if axis.limits:
            return axis.limits
        values = np.concatenate([np.zeros(0), *(_values(item, direction) for item in self.items)])
        shown = values[np.isfinite(values) & ((values > 0.0) | (not axis.log))]
        return (float(shown.min()), float(shown.max())) if shown.size else (1.0, 10.0)


def _apart(value: float, log: bool) -> tuple[float, float]:
    if log:
        return value / SINGLE, value * SINGLE
    distance = (SINGLE - 1.0) * abs(value) or 1.0
    return value - distance, value + distance


def _values(item: Item, direction: Literal["x", "y"]) -> Values:
    if isinstance(item, Band) and direction == "y":
        return np.concatenate([item.low, item.high]).astype(float)
    if isinstance(item, (Curve, Points, Band)):
        return np.asarray(getattr(item, direction), float)
    return np.zeros(0)


def log_factors(low: float, high: float) -> tuple[int, ...]:
    """Numbers that a logarithmic axis has in each power of ten: all, 1, 2 and 5, or 1 alone where they are many."""
    ratio = high / low
    return tuple(range(1, 10)) if ratio < NARROW else (1, 2, 5) if ratio < WIDE else (1,)


def log_marks(low: float, high: float) -> list[float]:
    """Places of the numbers of a logarithmic axis, a power of ten beyond its ends included."""
    powers = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 2)
    return [factor * 10.0**power for power in powers for factor in log_factors(low, high)]


@dataclass(frozen=True)
class Table:
    """The numbers of a chart for those who cannot see it, or want them."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Drawing:
    """A figure before it is drawn; `amb_core.report.figures.chart.Chart` adds the ways to draw it.

    Attributes
    ----------
    title : str
        Heading.
    alt : str
        What the figure shows, in a sentence or two, for those who cannot see it.
    panels : tuple of Panel
        Row by row.
    columns : int
        Panels in a row.
    shared_x : bool
        Whether the panels of a column have one x axis, labelled at the bottom.
    size : tuple of float
        Width and height of the figure (inch); the page keeps the height and fits the width to the window.
    table : Table, optional
        Its main numbers. None for no table.
    """

    title: str
    alt: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared_x: bool = False
    size: tuple[float, float] = (8.0, 4.8)
    table: Table | None = None

    @property
    def rows(self) -> int:
        """Number of rows of panels."""
        return -(-len(self.panels) // self.columns)
