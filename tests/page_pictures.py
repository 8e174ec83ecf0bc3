"""Pages in Chromium at the sizes that readers have: whether they fit, and small pictures to compare with kept ones.

`python -m tests.unit.test_page_sizes` takes the pictures again and keeps them; look at them before they are committed.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from tests.graph.live_page import Visit, open_browser

WIDTHS = (400, 800, 1280)  # pixels of a phone, a tablet and a notebook
SCHEMES = ("light", "dark")
KEPT = Path(__file__).parent / "unit" / "data" / "pages"
DRAWN = "[...document.querySelectorAll('.plotly-graph-div')].every((chart) => chart.querySelector('.main-svg'))"
FITS = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
SMALL = 40  # pixels of a small picture's width
TILE = 8  # pixels of a tile's edge
TOLERANCE = 24.0  # of 255: difference of the means of a tile
MADE_WITH = "made with"


@dataclass(frozen=True)
class Look:
    """How a page is opened."""

    width: int
    scheme: str

    def __str__(self) -> str:
        return f"{self.width}_{self.scheme}"


LOOKS = tuple(Look(width, scheme) for width in WIDTHS for scheme in SCHEMES)


def visit(browser: Any, page: Path, look: Look) -> Visit:
    """A page whose figures are drawn."""
    viewport = {"width": look.width, "height": 900}
    opened = Visit(browser, page.as_uri(), viewport=viewport, color_scheme=look.scheme)
    opened.wait(DRAWN)
    return opened


def picture(opened: Visit) -> Image.Image:
    """The whole page, grey and small."""
    whole = Image.open(io.BytesIO(opened.page.screenshot(full_page=True))).convert("L")
    return whole.resize((SMALL, round(whole.height * SMALL / whole.width)), Image.Resampling.BOX)


def made_with(opened: Visit) -> str:
    """What decides how letters look: the browser's major version, and the widths of two texts in the page's font."""
    version = opened.page.context.browser.version.split(".")[0]
    widths = opened.value(
        """(() => { const pen = document.createElement("canvas").getContext("2d");
        return ["400 16px system-ui", "700 16px system-ui"].map((font) => { pen.font = font;
            return pen.measureText("Magnetic bearing 0123456789 ±").width.toFixed(1); }); })()"""
    )
    return f"Chromium {version}, widths of texts {', '.join(widths)}"


def tiles(image: Image.Image) -> np.ndarray:
    """Means of the tiles of a small picture, those at its lower end left out."""
    values = np.asarray(image, dtype=float)
    rows = values.shape[0] // TILE
    return values[: rows * TILE].reshape(rows, TILE, SMALL // TILE, TILE).mean(axis=(1, 3))


def differing_tiles(image: Image.Image, kept: Image.Image) -> list[tuple[int, int]]:
    """Row and column of the tiles that differ; all rows that only one of the pictures has."""
    mine, theirs = tiles(image), tiles(kept)
    rows = min(len(mine), len(theirs))
    differing = [
        (int(row), int(column)) for row, column in np.argwhere(np.abs(mine[:rows] - theirs[:rows]) > TOLERANCE)
    ]
    return differing + [(row, 0) for row in range(rows, max(len(mine), len(theirs)))]


def overflowing(pages: list[Path], browser: Any) -> Iterator[tuple[Path, Look]]:
    """Pages and looks at which a page is wider than its window."""
    for page in pages:
        for look in LOOKS:
            opened = visit(browser, page, look)
            if not opened.value(FITS):
                yield page, look
            opened.close()


def keep() -> None:
    """Take the pictures of the specimen and keep them."""
    from tests.page_specimen import write_specimen

    KEPT.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder, open_browser() as browser:
        page = write_specimen(Path(folder))
        for look in LOOKS:
            opened = visit(browser, page, look)
            notes = PngInfo()
            notes.add_text(MADE_WITH, made_with(opened))
            picture(opened).save(KEPT / f"{look}.png", pnginfo=notes, optimize=True)
            opened.close()
