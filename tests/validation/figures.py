"""What `make validate` writes to results/validation.json."""

from __future__ import annotations

from pydantic import RootModel

from tests.front_door.figures import Figures


class Row(Figures):
    """A check: what was measured and the most that it may be, in one unit."""

    name: str
    measured: float
    limit: float
    unit: str
    ok: bool


class Validation(RootModel[list[Row]]):
    """All checks; `run.CHECKS` has the number of rows of each."""
