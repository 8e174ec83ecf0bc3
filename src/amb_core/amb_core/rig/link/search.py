"""The search for a target: what answers to a HELLO counts only if the target with the key has answered this one."""

from __future__ import annotations

import os

from amb_core.rig.link.description import PER_PAGE, Description
from amb_core.rig.link.frames import hello
from amb_core.rig.link.layout import CHALLENGE


class Search:
    """Asks for the pages of a description, and keeps those that are genuine.

    A challenge, new in every search, keeps descriptions from being repeated by somebody in the network.

    Parameters
    ----------
    key : bytes
        Shared secret; empty: none.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self.begin()

    def begin(self) -> None:
        """Search anew: what has been asked before is no longer answered."""
        self._challenge = os.urandom(CHALLENGE)
        self._pages: dict[int, Description] = {}

    def questions(self) -> list[bytes]:
        """A HELLO for each page that is not there."""
        return [hello(first, challenge=self._challenge) for first in self._missing]

    def add(self, page: Description) -> str:
        """Take a page, or return why not. Those of another boot replace the ones before."""
        if page.challenge != self._challenge:
            return "its description answers another HELLO"
        if page.with_key and not self._key:
            return "it needs a key"
        if self._key and not page.with_key:
            return "it has no key, this host has one"
        if not page.genuine(self._key):
            return "its description has a wrong tag; is the key right?"
        if any(known.nonce != page.nonce or known.axes != page.axes for known in self._pages.values()):
            self._pages.clear()
        self._pages[page.first_axis] = page
        return ""

    @property
    def complete(self) -> list[Description] | None:
        """All pages in order; None as long as one is missing."""
        return None if self._missing else [self._pages[first] for first in sorted(self._pages)]

    @property
    def _missing(self) -> list[int]:
        axes = next(iter(self._pages.values())).axes if self._pages else 1
        return [first for first in range(0, axes, PER_PAGE) if first not in self._pages]
