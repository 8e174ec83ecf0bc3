"""The protocol of a commissioning: steps with checks, each with its number, its limit and its result."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

Result = Literal["passed", "failed", "skipped"]


@dataclass(frozen=True)
class Check:
    """One thing that was measured or asked.

    Attributes
    ----------
    what : str
        What it is.
    value : float or str
        The number, in the unit of the check, or a text.
    unit : str
        Its unit; `-` for none.
    limit : str
        What is allowed; empty without a limit.
    passed : bool or None
        Whether it is within the limit; None if nothing was compared.
    advice : str
        What to do if it is not.
    """

    what: str
    value: float | str
    unit: str = "-"
    limit: str = ""
    passed: bool | None = None
    advice: str = ""

    @property
    def shown(self) -> str:
        """The value with its unit."""
        if isinstance(self.value, str):
            return self.value
        return f"{self.value:.4g}" + ("" if self.unit == "-" else f" {self.unit}")


def measured(what: str, value: float | str, unit: str = "-") -> Check:
    """A value without a limit.

    Parameters
    ----------
    what : str
        What was measured.
    value : float or str
        The number, in the unit of the check, or a text.
    unit : str, optional
        Unit of the number; - for none.

    Returns
    -------
    Check
        A check that compares nothing.
    """
    return Check(what, value, unit)


def at_most(what: str, value: float, limit: float, unit: str = "-", advice: str = "") -> Check:
    """A value that passes up to a limit; NaN never does.

    Parameters
    ----------
    what : str
        What is checked.
    value : float
        The number, in the unit of the check.
    limit : float
        Largest value allowed, in the unit of the check.
    unit : str, optional
        Unit of the number; - for none.
    advice : str, optional
        What to do if it fails.

    Returns
    -------
    Check
        The check, passed or failed.
    """
    return Check(what, value, unit, f"at most {_number(limit, unit)}", bool(value <= limit), advice)


def at_least(what: str, value: float, limit: float, unit: str = "-", advice: str = "") -> Check:
    """A value that passes from a limit on; NaN never does."""
    return Check(what, value, unit, f"at least {_number(limit, unit)}", bool(value >= limit), advice)


def between(what: str, value: float, low: float, high: float, unit: str = "-", advice: str = "") -> Check:
    """A value that passes between two limits; NaN never does.

    Parameters
    ----------
    what : str
        What is checked.
    value : float
        The number, in the unit of the check.
    low, high : float
        Smallest and largest value allowed, in the unit of the check.
    unit : str, optional
        Unit of the number; - for none.
    advice : str, optional
        What to do if it fails.

    Returns
    -------
    Check
        The check, passed or failed.
    """
    return Check(what, value, unit, f"{low:.4g} to {_number(high, unit)}", bool(low <= value <= high), advice)


def _number(value: float, unit: str) -> str:
    return f"{value:.4g}" + ("" if unit == "-" else f" {unit}")


@dataclass
class Step:
    """A step of a commissioning.

    Attributes
    ----------
    name, title : str
        Short name, and what is done.
    began : str
        Date and time (ISO 8601, with the offset from UTC); empty if it was not begun.
    seconds : float
        Its duration (s).
    checks : list of Check
        What was measured.
    problem : str
        Why it failed, apart from its checks; empty otherwise.
    skipped : str
        Why it was not done; empty otherwise.
    """

    name: str
    title: str
    began: str = ""
    seconds: float = 0.0
    checks: list[Check] = field(default_factory=list)
    problem: str = ""
    skipped: str = ""

    @property
    def result(self) -> Result:
        """Failed if a check has failed or there was a problem."""
        if self.skipped:
            return "skipped"
        return "failed" if self.problem or any(check.passed is False for check in self.checks) else "passed"

    @property
    def reason(self) -> str:
        """Why it failed or was skipped, in one line; empty if it passed."""
        failed = [check for check in self.checks if check.passed is False]
        texts = [self.problem] if self.problem else []
        texts += [f"{check.what}: {check.shown} ({check.limit})" if check.limit else f"{check.what}: {check.shown}"
                  for check in failed]  # fmt: skip
        return self.skipped or "; ".join(texts)


@dataclass
class Protocol:
    """All steps, and what they were done with.

    Attributes
    ----------
    about : dict of str to str
        Machine, firmware, parameter file with its SHA-256, versions, date.
    steps : list of Step
        In the order in which they were done.
    """

    about: dict[str, str] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)

    @property
    def failed(self) -> list[Step]:
        """Steps that have failed."""
        return [step for step in self.steps if step.result == "failed"]

    def to_json(self) -> dict[str, Any]:
        """For a file: numbers in the unit of each check, null for a number that could not be determined.

        Returns
        -------
        dict of str to object
            JSON values by name.
        """
        return {
            "about": self.about,
            "result": "failed" if self.failed else "passed",
            "steps": [
                {
                    "name": step.name,
                    "title": step.title,
                    "result": step.result,
                    "reason": step.reason,
                    "began": step.began,
                    "seconds": step.seconds,
                    "checks": [
                        {
                            "what": check.what,
                            "value": None if _unknown(check.value) else check.value,
                            "unit": check.unit,
                            "limit": check.limit,
                            "passed": check.passed,
                            "advice": check.advice if check.passed is False else "",
                        }
                        for check in step.checks
                    ],
                }
                for step in self.steps
            ],
        }


def _unknown(value: float | str) -> bool:
    return not isinstance(value, str) and not math.isfinite(value)
