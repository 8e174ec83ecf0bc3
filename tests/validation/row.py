"""One check of the validation."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A deviation that was measured and the most that it may be, in one unit."""

    name: str
    measured: float
    limit: float
    unit: str

    @property
    def ok(self) -> bool:
        """Within the limit; NaN is not."""
        return bool(self.measured <= self.limit)
