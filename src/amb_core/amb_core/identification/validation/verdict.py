"""The one function that decides how far a model is validated; commands, services and pages use its word."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """How far a model is validated, in words."""

    VALIDATED = "validated"
    RESERVATIONS = "validated with reservations"
    NOT_VALIDATED = "not validated"

    @property
    def code(self) -> str:
        """The word of the constants in Identify and Validate of amb_msgs."""
        return self.value.replace(" ", "_")


def verdict_of(follows: bool | None, explained: bool, new_data: bool = True) -> Verdict:
    """The verdict on a model.

    Parameters
    ----------
    follows : bool or None
        Whether its closed loop is stable and follows each output with the required fit; None where there is none.
    explained : bool
        Whether past inputs explain nothing, or next to nothing, of its residuals.
    new_data : bool, optional
        Whether the data are others than those of the estimate: on the same ones every model has reservations.
    """
    if not (explained if follows is None else follows):
        return Verdict.NOT_VALIDATED
    return Verdict.VALIDATED if explained and new_data else Verdict.RESERVATIONS
