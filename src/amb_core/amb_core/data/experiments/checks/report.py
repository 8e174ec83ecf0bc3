"""Findings of the data checks, one per check, in plain words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from amb_core.ground.errors import IdentificationError


class Severity(IntEnum):
    """How much a finding matters."""

    INFO = 0
    """As it should be, or good to know."""
    WARNING = 1
    """The model will be worse than the data could be."""
    ERROR = 2
    """These data determine no model."""


@dataclass(frozen=True)
class Finding:
    """What one check found.

    Attributes
    ----------
    check : str
        What was checked.
    severity : Severity
        How much it matters.
    what : str
        What was found, with numbers.
    where : str
        Signals, experiments or steps concerned; empty for the data as a whole.
    advice : str
        What to do; empty if nothing needs to be done.
    """

    check: str
    severity: Severity
    what: str
    where: str = ""
    advice: str = ""

    def __str__(self) -> str:
        """One line."""
        return f"{self.severity.name.lower():<8}{self.check:<12}{self.text}"

    @property
    def text(self) -> str:
        """Where, what and advice as one phrase."""
        where = f"{self.where}: " if self.where else ""
        advice = f"; {self.advice}" if self.advice else ""
        return f"{where}{self.what}{advice}"


@dataclass(frozen=True)
class DataReport:
    """All findings about one data set.

    Attributes
    ----------
    data : str
        What the data are, in one line.
    findings : tuple of Finding
        One for each check, in the order in which they were made.
    """

    data: str
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> list[Finding]:
        """Findings that prevent identification."""
        return [finding for finding in self.findings if finding.severity is Severity.ERROR]

    @property
    def warnings(self) -> list[Finding]:
        """Findings that will make the model worse."""
        return [finding for finding in self.findings if finding.severity is Severity.WARNING]

    def finding(self, check: str) -> Finding:
        """The finding of a check.

        Parameters
        ----------
        check : str
            Name of the check.

        Returns
        -------
        Finding
            What it found.

        Raises
        ------
        KeyError
            If the check did not run: after an error in the samples themselves the other checks are left out.
        """
        return {finding.check: finding for finding in self.findings}[check]

    def refuse_errors(self) -> None:
        """Raise the errors, if any.

        Raises
        ------
        IdentificationError
            With all of them in one line.
        """
        if self.errors:
            raise IdentificationError("; ".join(f"{finding.check}: {finding.text}" for finding in self.errors))

    def __str__(self) -> str:
        """The data, and a line for each finding."""
        return "\n".join([self.data, *map(str, self.findings)])
