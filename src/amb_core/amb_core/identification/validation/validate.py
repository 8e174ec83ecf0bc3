"""One call from a model and data to a verdict: prediction, residuals, closed loop and frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from amb_core.distortion import Evidence
from amb_core.errors import IdentificationError
from amb_core.identification.controller_check import check_controller
from amb_core.identification.data import Finding, IdentificationData, Severity, restore
from amb_core.identification.data.checks import check_recording, evidence_of
from amb_core.identification.numerics import one_blas_thread
from amb_core.identification.validation.frequency import FrequencyComparison, compare_responses
from amb_core.identification.validation.prediction import Prediction, predict
from amb_core.identification.validation.report import report_text, report_values, summary_line
from amb_core.identification.validation.residuals import LAGS, NEGLIGIBLE, ResidualTests, check_residuals
from amb_core.identification.validation.simulation import ClosedLoop, check_closed_loop
from amb_core.identification.validation.verdict import Verdict, verdict_of
from amb_core.loop.known_controller import KnownController
from amb_core.model.state_space import StateSpaceModel

if TYPE_CHECKING:
    from amb_core.identification.uncertainty import ModelUncertainty
    from amb_core.plant import PlantParameters

HORIZONS = (1, 5, 20, 100)


@dataclass(frozen=True, eq=False)
class Validation:
    """Validation of a model on data.

    Attributes
    ----------
    model : StateSpaceModel
        The model.
    data : IdentificationData
        The data, with removed trends added again.
    horizons : tuple of int
        Requested prediction horizons (steps).
    prediction : Prediction
        Predictions over the horizons.
    residuals : ResidualTests
        Whiteness of the one-step prediction errors and their independence of past inputs.
    closed_loop : ClosedLoop or None
        Simulation with the known controller; None if controller or reference are not known.
    frequency : FrequencyComparison
        The model's frequency response compared with other estimates of the plant's.
    evidence : Evidence
        Distortion of these data, or coherence of position and reference: what no linear model can follow.
    notes : tuple of str
        What was left out, and why, and the warnings of `findings`.
    findings : tuple of Finding
        What the samples of the data show, see `check_recording`, and whether the controller is that of the data.
    """

    model: StateSpaceModel
    data: IdentificationData
    horizons: tuple[int, ...]
    prediction: Prediction
    residuals: ResidualTests
    closed_loop: ClosedLoop | None
    frequency: FrequencyComparison
    evidence: Evidence
    notes: tuple[str, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def fit(self) -> NDArray[np.float64]:
        """Closed-loop fit of each output (percent), shape (p,); empty where the closed loop was left out."""
        return np.empty(0) if self.closed_loop is None else self.closed_loop.fit

    @property
    def one_step_fit(self) -> NDArray[np.float64]:
        """Fit of the one-step prediction of each output (percent), shape (p,)."""
        return self.prediction.fit_at(1)

    @property
    def white(self) -> bool:
        """Whether the residuals pass the test of whiteness at 99 %."""
        return self.residuals.whiteness.passed

    @property
    def independent(self) -> bool:
        """Whether the residuals pass the test of independence of past inputs at 99 %."""
        return self.residuals.independence.passed

    @property
    def closed_loop_stable(self) -> bool | None:
        """Whether model and controller make a stable loop; None if the closed loop was left out."""
        return None if self.closed_loop is None else self.closed_loop.stable

    @property
    def validated(self) -> bool:
        """Whether the model passes the criterion for its use, if with reservations.

        If controller and reference are known: its closed loop is stable and follows each output with a fit of 90 % or
        more. If not: past inputs explain nothing, or less than 5 %, of the variance of the residuals.
        """
        return self.verdict is not Verdict.NOT_VALIDATED

    @property
    def unreserved(self) -> bool:
        """Whether the residuals are independent of past inputs, or as good as independent: less than 5 % explained."""
        return self.independent or self.residuals.independence.unexplained < NEGLIGIBLE

    @property
    def verdict(self) -> Verdict:
        """Validated, validated with reservations (residuals depend on past inputs), or not validated."""
        return verdict_of(None if self.closed_loop is None else self.closed_loop.follows, self.unreserved)

    @property
    def summary(self) -> str:
        """One line of text."""
        return summary_line(self)

    def report(self) -> str:
        """All results on one page of plain text, with verdicts and advice."""
        return report_text(self)

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain values for strict JSON; values that are not finite are None."""
        return report_values(self)


def validate(
    model: StateSpaceModel,
    data: IdentificationData,
    controller: KnownController | None = None,
    *,
    uncertainty: ModelUncertainty | None = None,
    plant: PlantParameters | None = None,
    horizons: Sequence[int] | None = None,
    lags: int = LAGS,
) -> Validation:
    """Validate a model, ideally on data that it was not identified from.

    Parameters
    ----------
    model : StateSpaceModel
        The model; its predictor must be stable.
    data : IdentificationData
        Data with the model's signals and sample time.
    controller : KnownController, optional
        The controller of the experiments; without it the closed loop is left out.
    uncertainty : ModelUncertainty, optional
        Uncertainty of the model, for its frequency response.
    plant : PlantParameters, optional
        The plant, if it is known, such as that of the simulator.
    horizons : sequence of int, optional
        Prediction horizons (steps); by default those of `HORIZONS` that are at most half the shortest experiment.
    lags : int
        Lags over which residuals are tested.

    Raises
    ------
    IdentificationError
        If model and data do not fit together, the predictor is unstable, or the data are too short or do not move.
    """
    data = restore(_fitting(data, model))
    if horizons is None:
        shortest = min(item.steps for item in data.experiments)
        horizons = [horizon for horizon in HORIZONS if 2 * horizon <= shortest]
    if controller is not None:
        controller.require_axes(len(data.output_names))
    # The matrices are small: more BLAS threads cost time, and take cores from the control loop.
    with one_blas_thread():
        prediction = predict(model, data, horizons)
        residuals = check_residuals(
            prediction.residuals,
            [item.inputs for item in data.experiments],
            lags,
            model.order * (2 * len(model.c) + model.b.shape[1]) + (model.d.size if np.any(model.d) else 0),
            model.samples,
        )
        closed_loop, loop_notes = _closed_loop(model, data, controller, prediction)
        frequency, frequency_notes = compare_responses(model, data, controller, uncertainty, plant)
    findings = (*check_recording(data), check_controller(data, controller))
    warnings = [f"{finding.check}: {finding.text}" for finding in findings if finding.severity is not Severity.INFO]
    undecided = uncertainty.at_one if uncertainty is not None else ""
    return Validation(
        model,
        data,
        tuple(sorted({1, *horizons})),
        prediction,
        residuals,
        closed_loop,
        frequency,
        evidence_of(data),
        (*([f"poles: {undecided}"] if undecided else []), *loop_notes, *warnings, *frequency_notes),
        findings,
    )


def _fitting(data: IdentificationData, model: StateSpaceModel) -> IdentificationData:
    """The data, if they suit the model."""
    if abs(data.sample_time / model.sample_time - 1.0) > 1e-9:
        raise IdentificationError(
            f"the data have a sample time of {data.sample_time:g} s, the model of {model.sample_time:g} s; "
            "a model can only be validated on data with its own sample time"
        )
    for kind in ("input", "output"):
        mine, theirs = getattr(model, f"{kind}_names"), getattr(data, f"{kind}_names")
        if mine != theirs:
            raise IdentificationError(
                f"the data have the {kind}s {', '.join(theirs)}, the model {', '.join(mine)}; they must be the same"
            )
    for index, item in enumerate(data.experiments):
        if not np.isfinite(item.signals).all():
            raise IdentificationError(
                f"experiment {index} holds values that are not finite; use split_at_invalid to leave them out"
            )
    return data


def _closed_loop(
    model: StateSpaceModel, data: IdentificationData, controller: KnownController | None, prediction: Prediction
) -> tuple[ClosedLoop | None, list[str]]:
    """The closed loop of the experiments with a known reference, and notes on what was left out."""
    if controller is None:
        return None, ["closed loop: left out, because the controller is not known"]
    known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
    if not known:
        return None, ["closed loop: left out, because the data have no reference"]
    notes = []
    if unknown := len(data.experiments) - len(known):
        notes.append(f"closed loop: {unknown} experiment{'s' if unknown > 1 else ''} without reference left out")
    measured = [data.record(index) for index in known]
    return check_closed_loop(model, controller, measured, prediction.first_states[known]), notes
