"""Looks that all figures share: colours that colour-blind readers can tell apart, and strokes that differ in dash too.

Colours: Okabe and Ito, "Color Universal Design", https://jfly.uni-koeln.de/color/. Each has a contrast of some 2:1 or
more with white and with the dark background of the pages. No figure relies on colour alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from amb_core.regions import Region

BLUE, SKY, GREEN, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#E69F00"
VERMILION, PURPLE, GREY = "#D55E00", "#CC79A7", "#8C8C8C"

OPACITY = 0.22
"""Of the areas of regions: light enough for what is drawn over them."""

FADED = 0.3
"""Opacity of what hardly matters, relative to what does."""

Dash = Literal["solid", "dash", "dot", "dashdot"]
Hatch = Literal["", "/", "\\", "x", "."]
Marker = Literal["circle", "square", "diamond", "triangle", "cross"]


@dataclass(frozen=True)
class Stroke:
    """How a line is drawn: colour, dash, width (pt), and opacity where it is faded."""

    colour: str
    dash: Dash = "solid"
    width: float = 1.4
    opacity: float = 1.0


PLANT = Stroke(BLUE)
MODEL = Stroke(VERMILION, "dash", 1.1)
REFERENCE = Stroke(GREY, width=0.8)
MODELS = (MODEL, Stroke(GREEN, "dashdot", 1.2), Stroke(PURPLE, "dot", 1.4), Stroke(ORANGE, "solid", 1.0))
"""Of several models in one figure, in turn."""
MEAN = Stroke(ORANGE, "dashdot", 1.8)


@dataclass(frozen=True)
class RegionLook:
    """How a region is drawn: its colour, hatch, the dash of the line at which it begins, and a marker.

    `meaning` is what the region is, in a few words.
    """

    colour: str
    hatch: Hatch
    dash: Dash
    marker: Marker
    meaning: str

    @property
    def boundary(self) -> Stroke:
        """The line at which the region begins."""
        return Stroke(self.colour, self.dash, 2.0)


REGIONS: dict[Region, RegionLook] = {
    Region.A: RegionLook(SKY, "", "solid", "circle", "steady bias"),
    Region.B: RegionLook(ORANGE, "/", "dash", "square", "drifting bias"),
    Region.C: RegionLook(PURPLE, ".", "dashdot", "triangle", "slow oscillation"),
    Region.D: RegionLook(VERMILION, "x", "solid", "diamond", "delevitated"),
}


def sentence(text: str) -> str:
    """The text with its first letter in upper case and the others as they are: `str.capitalize` makes dB db."""
    return f"{text[:1].upper()}{text[1:]}"


def region_label(region: Region) -> str:
    """A region as legends name it, such as `B drifting bias`."""
    return f"{region.name} {REGIONS[region].meaning}"
