"""What `make validate` writes to results/validation.json."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, RootModel

from tests.front_door.figures import Figures


class Row(Figures):
    """A check: what was measured and the most that it may be, in one unit."""

    name: str
    measured: float
    limit: float
    unit: str
    ok: bool


def _all_rows(rows: list[Row]) -> list[Row]:
    from tests.validation.run import CHECKS

    declared = sum(count for _, count, _ in CHECKS.values())
    if len(rows) != declared:
        raise ValueError(f"has {len(rows)} rows; declared: {declared}")
    return rows


class Validation(RootModel[Annotated[list[Row], AfterValidator(_all_rows)]]):
    """All checks; `run.CHECKS` has the number of rows of each."""
