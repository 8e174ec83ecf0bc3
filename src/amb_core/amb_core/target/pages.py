"""The description of a target, page by page as it arrives."""

from __future__ import annotations

from amb_core.target.answers import PER_PAGE, Description


class Pages:
    """The pages of a description as they arrive; those of another boot replace them."""

    def __init__(self) -> None:
        self._pages: dict[int, Description] = {}

    def add(self, page: Description) -> None:
        """Take a page."""
        if any(known.nonce != page.nonce for known in self._pages.values()):
            self._pages.clear()
        self._pages[page.first_axis] = page

    @property
    def missing(self) -> list[int]:
        """First axis of each page that is not there."""
        axes = next(iter(self._pages.values())).axes if self._pages else 1
        return [first for first in range(0, axes, PER_PAGE) if first not in self._pages]

    @property
    def complete(self) -> list[Description] | None:
        """All of them in order; None as long as one is missing."""
        return None if self.missing else [self._pages[first] for first in sorted(self._pages)]
