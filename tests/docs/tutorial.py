"""What the tutorial states, and whether following it reproduces that: lines of output, numbers in prose, pictures."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from amb_core.identification import StateSpaceModel
from tests.docs.pages import DOCS, Block, Reader, assert_shows, blocks_of

PAGE = DOCS / "tutorial" / "my-bearing.md"
SAME_PICTURE = 0.5
"""Largest mean difference of grey levels (of 255) of a picture and the kept one, both 300 by 200.

Fonts and palettes differ by less than 0.1; a map with two sweeps more differs by several levels.
"""


@dataclass(frozen=True)
class Statement:
    """A sentence of the page, and whether the files and outputs of its commands agree with it."""

    text: str
    holds: Callable[[Path, str], bool]


@dataclass
class Walk:
    """Somebody who followed the page.

    Attributes
    ----------
    commands : int
        Commands that were typed.
    seconds : float
        Time that all took (s).
    reproduced, missed : list of str
        Statements that came out as the page has them, and those that did not.
    """

    commands: int = 0
    seconds: float = 0.0
    reproduced: list[str] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def note(self, statements: list[str], holds: bool) -> None:
        """Count statements that hold together or not."""
        (self.reproduced if holds else self.missed).extend(statements)


def text_of(sections: int | None = None) -> str:
    """The page, or its opening and first sections."""
    return "## ".join(PAGE.read_text(encoding="utf-8").split("## ")[: None if sections is None else sections + 1])


def follow(somebody: Reader, sections: int | None = None) -> Walk:
    """Follow the page, or its first sections, and compare all that it states with what comes out."""
    walk, begun, text = Walk(), time.monotonic(), text_of(sections)
    seen = []
    for block in blocks_of(text):
        if block.language == "output":
            walk.note(_lines(block), _shows(somebody.shown, block))
            continue
        somebody.do(block)
        if block.language == "bash":
            walk.commands += len([line for line in block.text.splitlines() if line.startswith("amb ")])
            seen.append(somebody.shown)
    walk.seconds = time.monotonic() - begun
    words = " ".join(text.split())
    for statement in STATEMENTS:
        if statement.text in words:
            walk.note([statement.text], statement.holds(somebody.folder, "\n".join(seen)))
    for kept, made in PICTURES.items():
        if kept in text:
            walk.note([kept], _same(DOCS / "images" / kept, somebody.folder / made))
    return walk


def _lines(block: Block) -> list[str]:
    return [line for line in block.text.splitlines() if line.strip(" .")]


def _shows(shown: str, block: Block) -> bool:
    try:
        assert_shows(shown, block.text)
    except AssertionError:
        return False
    return True


def _same(kept: Path, made: Path) -> bool:
    images = [Image.open(path) for path in (kept, made)]
    grey = [np.asarray(image.convert("RGB").convert("L").resize((300, 200)), dtype=float) for image in images]
    return images[0].size == images[1].size and float(np.abs(grey[0] - grey[1]).mean()) < SAME_PICTURE


def _read(folder: Path, name: str) -> Any:
    return json.loads((folder / "results" / name / "summary.json").read_text(encoding="utf-8"))


def _boundaries(folder: Path, amplitude: int) -> dict[str, float]:
    """Boundaries (Hz) of the sweep with an amplitude (um)."""
    (sweep,) = [one for one in _read(folder, "map")["sweeps"] if round(1e6 * one["amplitude"]) == amplitude]
    return {name: float(value) for name, value in sweep["boundaries"].items()}


def _sweeps(folder: Path, _: str) -> bool:
    return len(_read(folder, "map")["sweeps"]) == 8


def _of_28_um(folder: Path, _: str) -> bool:
    return round(_boundaries(folder, 28)["B"], -1) == 470


def _of_100_um(folder: Path, _: str) -> bool:
    boundaries = _boundaries(folder, 100)
    return round(boundaries["B"], -1) == 170 and boundaries["D"] < 2.0 * boundaries["B"]


def _map_allows(folder: Path, _: str) -> bool:
    design = _read(folder, "excitation/design")
    return bool(design["map_amplitude"] > 3.0 * design["amplitude"])


def _largest(folder: Path, _: str) -> bool:
    return round(1e6 * _read(folder, "excitation/design")["largest_amplitude"], 1) == 13.5


def _linear(folder: Path, _: str) -> bool:
    regions = _read(folder, "regions")
    measured = [one["distortion_percent"] for one in regions["distortion"]["distortion"].values()]
    return regions["shares"]["A"] == 1.0 and all(0.3 < one < 0.7 for one in measured)


def _poles(folder: Path, _: str) -> bool:
    model = StateSpaceModel.load(folder / "results" / "model" / "model.json")
    rates = [math.log(abs(pole)) / model.sample_time for pole in model.unstable_poles()]
    return sorted(round(rate, 1) for rate in rates) == [371.6, 374.6]


def _plant_pole(_: Path, seen: str) -> bool:
    return re.search(r"unstable_pole\W+375\.9\W", seen) is not None


def _response(_: Path, seen: str) -> bool:
    bands = re.findall(r"^ +\d+ to \d+ +([1-9]\d*) +\S+ +(\S+) ", seen, re.MULTILINE)
    return bool(bands) and max(float(largest) for _, largest in bands) <= 1.5 and "determined from 11 to 495 Hz" in seen


def _explained(_: Path, seen: str) -> bool:
    shares = re.search(r"independent of past inputs +p = .*\n.*explains (\S+) % of the variance", seen)
    return shares is not None and round(float(shares[1]), 1) == 0.7


STATEMENTS = (
    Statement("Remember the unstable pole of 375.9 1/s.", _plant_pole),
    Statement("Eight simulated sweeps", _sweeps),
    Statement("A sine of 28 um may have up to 470 Hz before the bias begins to drift (B).", _of_28_um),
    Statement("At 100 um the limit is 170 Hz, and the rotor touches the backup bearing (D) soon after.", _of_100_um),
    Statement("The map alone would allow more than three times as much.", _map_allows),
    Statement("Above 13.5 um some signals of this kind may be too nonlinear", _largest),
    Statement("A steady bias and half a percent of distortion", _linear),
    Statement("The unstable poles are 374.6 and 371.6 1/s; the plant has 375.9 1/s.", _poles),
    Statement("to within 1.5 % from 11 to 495 Hz", _response),
    Statement("past inputs explain 0.7 % of the errors of one-step predictions", _explained),
)
"""Sentences with numbers; lines of output are compared as they stand."""

PICTURES = {
    "tutorial_stability.png": "results/tune/stability.png",
    "tutorial_map.png": "results/map/map.png",
    "tutorial_overlay.png": "results/excitation/design/overlay.png",
    "tutorial_bode.png": "results/validation/bode.png",
}
"""Kept pictures, and the files of the reader that they show."""


def numbers_in(text: str) -> Iterator[str]:
    """Sentences of prose, outside of code, headings and pictures, that have a number with a unit."""
    prose = re.sub(r"^```.*?^```$|^!\[.*?\)$|^#.*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    for sentence in re.split(r"(?<=[.:?!])\s", " ".join(prose.split())):
        if re.search(r"\d (?:%|um|Hz|1/s)(?:\W|$)", sentence):
            yield sentence
