"""How long a slow line must be there to be a slow oscillation, and how long it may be missing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class LineEvidence:
    """Successive tests of one window for a slow line. All counts are in tests.

    Attributes
    ----------
    persistence : int
        Positive tests that make an oscillation.
    patience : int
        Negative tests in a row that are tolerated on the way.
    hold : int
        Negative tests in a row after which an oscillation is over.
    since : int or None
        Step at which the line set in; None without evidence.
    active : bool
        Whether it is an oscillation.
    amplitude, frequency : float
        The largest line of the positive tests (m, Hz).
    """

    persistence: int
    patience: int
    hold: int
    since: int | None = None
    active: bool = False
    amplitude: float = 0.0
    frequency: float = 0.0
    _positive: int = 0
    _negative: int = 0

    def reset(self) -> None:
        """Forget everything."""
        self.active = False
        self._negative = 0
        self.withdraw()

    @property
    def suffices(self) -> bool:
        """Whether the positive tests suffice for an oscillation."""
        return self._positive >= self.persistence

    def find(self, amplitude: float, frequency: float, since: int) -> None:
        """Count a positive test: a line (m, Hz) that set in at a step."""
        self._negative = 0
        self._positive += 1
        if self.since is None:
            self.since = since
        if amplitude > self.amplitude:
            self.amplitude, self.frequency = amplitude, frequency

    def miss(self) -> None:
        """Count a negative test."""
        self._negative += 1
        if self._negative > self.patience and not self.active:
            self.withdraw()
        if self._negative > self.hold:
            self.reset()

    def withdraw(self) -> None:
        """There is no line, or it has another cause: start to count again."""
        self.since, self._positive = None, 0
        self.amplitude = self.frequency = 0.0
