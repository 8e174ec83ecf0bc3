"""Progress of the selection of an order: it moves with every decomposition of the data."""

from __future__ import annotations

from amb_core.identification.progress import Watch

_PREPARATIONS = 2
_USUAL_ITERATIONS = 8  # of a search on all samples


class OrderProgress:
    """Counts steps done, and the steps that are left as far as can be foreseen.

    Parameters
    ----------
    watch : Watch
        Receives the progress.
    orders : int
        Number of orders to test.
    reach : int
        Orders on either side of the best one that are searched on all samples.
    """

    def __init__(self, watch: Watch, orders: int, reach: int) -> None:
        self._watch = watch
        self._done, self._before = 0, orders + _PREPARATIONS  # steps done, and left before the searches
        self._searches = min(orders, 2 * reach + 1)
        self._left = 0  # iterations of the present search
        self._tell()

    def advance(self) -> None:
        """A step before the searches is done or begins."""
        self._before = max(self._before - 1, 0)
        self._step()

    def begin_search(self, searches: int) -> None:
        """A search on all samples begins; so many are left, this one included."""
        self._before, self._searches, self._left = 0, searches - 1, _USUAL_ITERATIONS
        self._step()

    def advance_search(self, _iteration: int, cost: float) -> None:
        """An iteration of a search is done."""
        self._left = max(self._left - 1, 0)
        self._step(cost)

    def end(self) -> None:
        """All is done."""
        self._watch.tell("order", self._done, self._done)

    def _step(self, cost: float | None = None) -> None:
        self._done += 1
        self._tell(cost)

    def _tell(self, cost: float | None = None) -> None:
        left = self._before + self._left + self._searches * (_USUAL_ITERATIONS + 1)
        self._watch.tell("order", self._done, self._done + max(left, 1), cost)
