"""Models validated on the same data, the best first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from amb_core.ground.errors import IdentificationError
from amb_core.ground.results import Result
from amb_core.identification.given import Controller, Data, Model, given_loop
from amb_core.identification.validation.validate import validate
from amb_core.identification.validation.validation import Validation
from amb_core.identification.validation.verdict import Verdict


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """Validations of several models on the same data.

    Attributes
    ----------
    validations : mapping of str to Validation
        By the name of the model, the best first: by verdict, then by the fit of the output that fits worst.
    refused : mapping of str to str
        Models that cannot be validated on these data, and why.
    """

    validations: Mapping[str, Validation]
    refused: Mapping[str, str]

    @property
    def summary(self) -> str:
        """One line of text."""
        names = ", ".join(f"{name} ({item.verdict})" for name, item in self.validations.items())
        return f"the best first: {names}" + (f"; refused: {', '.join(self.refused)}" if self.refused else "")

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Each model with its validation in a line."""
        return [*((name, item.summary) for name, item in self.validations.items()), *self.refused.items()]


def compare(models: Mapping[str, Model], data: Data, controller: Controller | None = None) -> Comparison:
    """Validate models on the same data, ideally on data that none was identified from.

    Parameters
    ----------
    models : mapping of str to StateSpaceModel or Identification
        By name.
    data : LoopRecord, IdentificationData or RecordedLoop
        As for `validate`.
    controller : KnownController, LinearSystem, control.StateSpace or str, optional
        The controller of the experiments; None for that of a RecordedLoop. Without any the closed loop is left out.

    Returns
    -------
    Comparison
        The validations, the best first, and the reasons of those that are not possible.

    Raises
    ------
    IdentificationError
        If none of the models can be validated, with the reasons; or they have no names.
    """
    if not isinstance(models, Mapping):
        raise IdentificationError(
            f"models: {type(models).__name__} is not allowed; allowed: models by name, such as {{'first': model}}"
        )
    loop = given_loop(data)
    validations, refused = {}, {}
    for name, model in models.items():
        try:
            validations[name] = validate(model, loop, controller)
        except IdentificationError as problem:  # the others can still be validated
            refused[name] = str(problem)
    if not validations:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in refused.items())
        raise IdentificationError(f"none of the models could be validated{': ' * bool(reasons)}{reasons}")
    return Comparison(dict(sorted(validations.items(), key=lambda item: _quality(item[1]), reverse=True)), refused)


def _quality(validation: Validation) -> tuple[int, float, float]:
    fit = validation.fit if len(validation.fit) else validation.one_step_fit
    return -list(Verdict).index(validation.verdict), float(fit.min()), float(validation.one_step_fit.min())
