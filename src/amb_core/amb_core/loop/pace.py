"""The pace of a loop that runs in real time: when each step is due, which came late, and by how much.

Step k is due k periods after the start. A step that is ready before is held back until then; one that is ready after it
has missed its deadline: it is counted, and the grid shifts by its lateness, so that the steps after it keep their
distance instead of hurrying. Times are those of a monotonic clock, given by the caller. A block of steps can be paced
just as well as a step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_SHORTEST, _LONGEST = 1e-7, 100.0  # s
PACED, MISSED, HISTOGRAM = " paced", "deadlines missed", "lateness histogram"
"""Keys of a report: after what is paced, its number of deadlines; how many of them were missed; `Lateness.to_text`."""
QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.99": 0.9999, "max": 1.0}
"""Shares of the distribution of the lateness that are reported, by name."""
_RATIO = 1.05  # of the edges of neighbouring bins: a quantile is at most 5 % above the true one


class Lateness:
    """How late steps came: a histogram over the logarithm of the time, of a size that does not grow.

    Attributes
    ----------
    count : int
        Steps noted.
    largest : float
        Largest lateness (s).
    """

    def __init__(self) -> None:
        self._bins = np.zeros(math.ceil(math.log(_LONGEST / _SHORTEST) / math.log(_RATIO)) + 1, dtype=np.int64)
        self.count = 0
        self.largest = 0.0

    def note(self, lateness: float) -> None:
        """Count a step that came `lateness` seconds after it was due."""
        place = 0 if lateness <= _SHORTEST else math.ceil(math.log(lateness / _SHORTEST) / math.log(_RATIO))
        self._bins[min(place, len(self._bins) - 1)] += 1
        self.count += 1
        self.largest = max(self.largest, lateness)

    def quantile(self, share: float) -> float:
        """Time (s) below which this share of the steps came, at most 5 % too large; 0 without steps."""
        if not self.count:
            return 0.0
        place = int(np.searchsorted(np.cumsum(self._bins), math.ceil(share * self.count)))
        return min(_SHORTEST * _RATIO**place, self.largest)

    def to_text(self) -> str:
        """The histogram as `place:count` of each bin that is not empty; `histogram` reads it."""
        return " ".join(f"{place}:{self._bins[place]}" for place in np.flatnonzero(self._bins))


def histogram(text: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Edges (s), shape (bins + 1,), and counts, shape (bins,), of a lateness as text, from its first bin to its last.

    The lowest bin holds every shorter lateness, too.
    """
    pairs = [tuple(map(int, item.split(":"))) for item in text.split()]
    if not pairs:
        return np.array([_SHORTEST]), np.zeros(0, np.int64)
    first, last = pairs[0][0], pairs[-1][0]
    counts = np.zeros(last - first + 1, np.int64)
    for place, count in pairs:
        counts[place - first] = count
    return _SHORTEST * _RATIO ** np.arange(first - 1, last + 1, dtype=float), counts


class Pace:
    """Deadlines of the steps of a loop.

    Parameters
    ----------
    period : float
        Wall-clock time between two steps (s).

    Attributes
    ----------
    period : float
        Wall-clock time between two steps (s); may be changed at any time.
    missed : int
        Steps that were ready only after they were due.
    shift : float
        Sum of the times by which missed deadlines have shifted the grid (s).
    lateness : Lateness
        Time of every step after it was due, in time or not.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._due = math.nan
        self.missed = 0
        self.shift = 0.0
        self.lateness = Lateness()

    def start(self, now: float) -> None:
        """A step was published at `now` (s): the next one is due a period later. Counts go on."""
        self._due = now + self.period

    def wait(self, now: float) -> float:
        """Time (s) for which the step that is ready at `now` (s) is held back; 0 if it has missed its deadline."""
        left = self._due - now
        if left >= 0.0:
            return left
        self.lateness.note(-left)
        self._miss(-left, now)
        return 0.0

    def published(self, now: float) -> None:
        """The step that was held back was published at `now` (s); if a whole period late, it missed its deadline."""
        late = max(now - self._due, 0.0)
        self.lateness.note(late)
        if late >= self.period:
            self._miss(late, now)
        else:
            self._due += self.period

    def postpone(self, seconds: float) -> None:
        """The loop stands still for so long (s) on purpose: the steps after it are due later, and none is missed."""
        self._due += seconds

    def _miss(self, late: float, now: float) -> None:
        self.missed += 1
        self.shift += late
        self.start(now)


def pace_values(pace: Pace, paced: str = "steps") -> dict[str, int | str]:
    """Missed deadlines and the distribution of the lateness, for /diagnostics.

    Parameters
    ----------
    pace : Pace
        The pace.
    paced : str
        What it paces: steps, or blocks of them.
    """
    quantiles = {
        f"lateness {name} (us)": f"{1e6 * pace.lateness.quantile(share):.3g}" for name, share in QUANTILES.items()
    }
    counts: dict[str, int | str] = {f"{paced}{PACED}": pace.lateness.count, MISSED: pace.missed}
    return counts | quantiles | {HISTOGRAM: pace.lateness.to_text()}
