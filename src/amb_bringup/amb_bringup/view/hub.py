"""Pushes what is new to the pages: the same bytes to all that stand at the same place, nothing to one that is slow."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any, Protocol

from amb_bringup.view.picture import Picture
from amb_bringup.view.samples import Seen

FRAME_RATE = 30.0  # Hz
STATES_EVERY = 3  # frames
SPECTRUM_EVERY = 6  # frames
MOST_PAGES = 32


class Page(Protocol):
    """An open page, as the hub sees it.

    Attributes
    ----------
    seen : Seen
        The samples that it has.
    known : dict
        The version of each section that it has.
    line : int
        Number of the last line of the log that it has.
    """

    seen: Seen
    known: dict[str, int]
    line: int

    def ready(self) -> bool:
        """Whether everything sent so far has left."""

    def send(self, message: str | bytes) -> None:
        """Send a message, without waiting."""


class Hub:
    """The open pages, and what they get with each frame.

    Parameters
    ----------
    picture : Picture
        What the graph shows.
    """

    def __init__(self, picture: Picture) -> None:
        self.pages: set[Page] = set()
        self._picture = picture
        self._frames = 0
        self._texts: dict[str, tuple[int, str]] = {}  # of each section: version and JSON

    def tick(self) -> None:
        """Send one frame to every page."""
        self._frames += 1
        pages = [page for page in self.pages if page.ready()]
        self._send_layout([page for page in pages if page.seen.epoch != self._picture.samples.epoch])
        self._send_samples(pages)
        if self._frames % STATES_EVERY == 0:
            self._picture.update()
            self._send_states(pages)
        if self._frames % SPECTRUM_EVERY == 0:
            self._send_spectrum(pages)

    def _send_layout(self, pages: list[Page]) -> None:
        """A page draws no frame of a run whose layout it does not have, so that comes first."""
        if pages:
            self._picture.update()
            self._send_states(pages)

    def _send_samples(self, pages: list[Page]) -> None:
        made: dict[Any, tuple[bytes | None, Seen]] = {}
        for page in pages:
            seen = page.seen
            place = (seen.level, seen.epoch, seen.column, seen.point)
            if place not in made:
                made[place] = (self._picture.samples.frame(seen), seen)
            frame, after = made[place]
            if frame is not None:
                page.seen = replace(after)
                page.send(frame)

    def _send_states(self, pages: list[Page]) -> None:
        for name, value in self._picture.sections.items():
            text = json.dumps(value, allow_nan=False, separators=(",", ":"))
            version, before = self._texts.get(name, (0, ""))
            if text != before:
                self._texts[name] = (version + 1, text)
        for page in pages:
            new = {name: text for name, (version, text) in self._texts.items() if page.known.get(name) != version}
            page.known |= {name: self._texts[name][0] for name in new}
            lines = [line for line in self._picture.log if line["number"] > page.line]
            if not new and not lines:
                continue
            page.line = lines[-1]["number"] if lines else page.line
            sections = ",".join(f"{json.dumps(name)}:{text}" for name, text in new.items())
            page.send(f'{{"type":"state","sections":{{{sections}}},"log":{json.dumps(lines, allow_nan=False)}}}')

    def _send_spectrum(self, pages: list[Page]) -> None:
        if pages and (spectrum := self._picture.samples.spectrum()) is not None:
            for page in pages:
                page.send(spectrum)
