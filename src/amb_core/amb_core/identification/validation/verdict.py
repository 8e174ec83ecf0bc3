"""How far a model is validated: three levels, and the conditions that decide."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

SIGNIFICANT = 1e-3
"""Probability for a true model below which a finding is significant."""


class Verdict(StrEnum):
    """How far a model is validated, in words."""

    VALIDATED = "validated"
    RESERVATIONS = "validated with reservations"
    NOT_VALIDATED = "not validated"

    @property
    def code(self) -> str:
        """The word of the constants in Identify and Validate of amb_msgs."""
        return self.value.replace(" ", "_")


@dataclass(frozen=True)
class Condition:
    """One condition of the verdict.

    Attributes
    ----------
    key : str
        Its name in programs.
    name : str
        What is asked.
    finding : str
        What was found, with numbers.
    limit : str
        What is allowed, with numbers.
    level : Verdict
        The best verdict that this finding allows.
    advice : str
        What to do; empty if it holds.
    checked : bool
        Whether there was anything to check it with. What could not be checked leaves reservations; what does not apply
        to this model holds no verdict back, and no page says that it holds.
    """

    key: str
    name: str
    finding: str
    limit: str
    level: Verdict = Verdict.VALIDATED
    advice: str = ""
    checked: bool = True

    @property
    def passed(self) -> bool:
        """Whether it holds without reservation."""
        return self.level is Verdict.VALIDATED


def worst_of(conditions: Iterable[Condition]) -> Verdict:
    """The verdict that all conditions allow."""
    order = list(Verdict)
    return max((condition.level for condition in conditions), key=order.index, default=Verdict.NOT_VALIDATED)
