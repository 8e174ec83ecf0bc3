"""The measures of a validation with their verdict."""

from __future__ import annotations

from functools import cached_property

from amb_core.identification.validation.judge import judge
from amb_core.identification.validation.measures import Measures
from amb_core.identification.validation.verdict import Condition, Verdict, worst_of


class JudgedMeasures(Measures):
    """The measures of a validation, judged by the conditions of `judge`."""

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """All conditions of the verdict, with their findings."""
        return judge(self)

    @property
    def failed(self) -> tuple[Condition, ...]:
        """The conditions that do not hold, those that refuse the model first."""
        order = list(Verdict)
        failed = [condition for condition in self.conditions if not condition.passed]
        return tuple(sorted(failed, key=lambda condition: -order.index(condition.level)))

    @property
    def verdict(self) -> Verdict:
        """What all conditions allow."""
        return worst_of(self.conditions)

    @property
    def validated(self) -> bool:
        """Whether no condition refuses the model; there may be reservations."""
        return self.verdict is not Verdict.NOT_VALIDATED
