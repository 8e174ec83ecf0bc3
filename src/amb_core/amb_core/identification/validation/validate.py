"""One call from a model and data to a verdict: prediction, residuals, closed loop and frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.controller_choice import suits_controller
from amb_core.data.experiments import Finding, IdentificationData, Severity, restore
from amb_core.data.experiments.checks import check_recording, evidence_of
from amb_core.ground.errors import IdentificationError
from amb_core.ground.results import Result
from amb_core.identification.controller_check import NOT_CHECKED, check_controller
from amb_core.identification.given import Data, Model, given_loop, given_model
from amb_core.identification.progress import SearchEnd
from amb_core.identification.validation.deviations import Deviation, find_deviations
from amb_core.identification.validation.frequency import FrequencyComparison, compare_responses, in_open_loop
from amb_core.identification.validation.judge import NOTED, judge
from amb_core.identification.validation.model_error import BandError, response_errors
from amb_core.identification.validation.overlap import overlap
from amb_core.identification.validation.prediction import Prediction, predict
from amb_core.identification.validation.report import report_text, report_values, summary_line
from amb_core.identification.validation.residuals import LAGS, ResidualTests, check_residuals
from amb_core.identification.validation.ringing import Ringing, find_ringing
from amb_core.identification.validation.simulation import ClosedLoop, PossibleFit, check_closed_loop, possible_fit
from amb_core.identification.validation.verdict import Condition, Verdict, worst_of
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import one_blas_thread
from amb_core.loop.known_controller import KnownController
from amb_core.regions.distortion import Evidence

if TYPE_CHECKING:
    from amb_core.identification.uncertainty import ModelUncertainty
    from amb_core.plant import PlantParameters

HORIZONS = (1, 5, 20, 100)


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Result):
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
        What was left out, and why.
    controller_check : Finding
        Whether the controller computed the recorded currents.
    findings : tuple of Finding
        What the samples of the data show, see `check_recording`.
    band_errors : tuple of BandError
        Error of the model's response in each band of which the data say anything.
    deviations : tuple of Deviation
        Kinds of deviation of the plant, the least probable for a true model first.
    ringing : Ringing or None
        The most significant peak in the spectrum of the residuals. None if no peak is significant.
    possible_fit : PossibleFit or None
        Closed-loop fit that a true model reaches with the noise of these data; None without a stable loop.
    without_loop : str
        Why there is no closed loop; empty if there is one.
    overlap : float
        Share of the samples of the identification that these data hold again, about (-).
    search : SearchEnd or None
        How the search of the identification ended, where it is known. None otherwise.
    undecided : str or None
        What the uncertainty says of poles whose stability is not decided; empty if there is nothing, None without it.
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
    controller_check: Finding
    findings: tuple[Finding, ...] = ()
    band_errors: tuple[BandError, ...] = ()
    deviations: tuple[Deviation, ...] = ()
    ringing: Ringing | None = None
    possible_fit: PossibleFit | None = None
    without_loop: str = ""
    overlap: float = 0.0
    search: SearchEnd | None = None
    undecided: str | None = None

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
        """Whether the residuals pass the test of whiteness at 99.9 %."""
        return self.residuals.whiteness.passed

    @property
    def independent(self) -> bool:
        """Whether the residuals pass the test of independence of past inputs at 99.9 %."""
        return self.residuals.independence.passed

    @property
    def closed_loop_stable(self) -> bool | None:
        """Whether model and controller make a stable loop; None if the closed loop was left out."""
        return None if self.closed_loop is None else self.closed_loop.stable

    @cached_property
    def possible_one_step_fit(self) -> NDArray[np.float64]:
        """One-step fit of each output that the past of all signals explains (percent), shape (p,)."""
        tests = zip(self.residuals.whiteness_by_output, self.residuals.independence_by_output, strict=True)
        left = np.array(
            [min(1.0, max(1.0 - white.beyond_chance - driven.beyond_chance, 0.0)) for white, driven in tests]
        )
        return np.asarray(100.0 - (100.0 - self.one_step_fit) * np.sqrt(left))

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

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The conditions with their findings, those that do not hold first."""
        held = (condition for condition in self.conditions if condition.passed)
        return [(one.name, f"{'' if one.passed else f'{one.level}: '}{one.finding}") for one in (*self.failed, *held)]

    @property
    def summary(self) -> str:
        """One line of text."""
        return summary_line(self)

    def report(self) -> str:
        """All results on one page of plain text, with verdicts and advice.

        Returns
        -------
        str
            Text of several lines.
        """
        return report_text(self)

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain values for strict JSON; values that are not finite are None.

        Returns
        -------
        dict of str to object
            Values by name.
        """
        return report_values(self)


def validate(
    model: Model,
    data: Data,
    controller: KnownController | None = None,
    *,
    uncertainty: ModelUncertainty | None = None,
    plant: PlantParameters | None = None,
    search: SearchEnd | None = None,
    horizons: Sequence[int] | None = None,
    lags: int = LAGS,
) -> Validation:
    """Validate a model, ideally on data that it was not identified from.

    Parameters
    ----------
    model : StateSpaceModel or Identification
        The model, or the result of its identification; its predictor must be stable.
    data : LoopRecord, IdentificationData or RecordedLoop
        Data with the model's signals and sample time; the last is what `amb_core.read` returns.
    controller : KnownController, optional
        The controller of the experiments; by default that of a RecordedLoop. Without it the closed loop is left out.
    uncertainty : ModelUncertainty, optional
        Uncertainty of the model, for its frequency response; by default that of an Identification.
    plant : PlantParameters, optional
        The plant, if it is known, such as that of the simulator; by default that of a RecordedLoop.
    search : SearchEnd, optional
        How the search of the identification ended, if it is known; by default that of an Identification.
    horizons : sequence of int, optional
        Prediction horizons (steps); by default those of `HORIZONS` that are at most half the shortest experiment.
    lags : int, optional
        Lags over which residuals are tested.

    Returns
    -------
    Validation
        Predictions, residuals, closed loop and responses with their verdicts.

    Raises
    ------
    IdentificationError
        If model and data do not fit together, the predictor is unstable, or the data are too short or do not move.
    """
    loop, identified = given_loop(data), model
    model = given_model(model)
    if not isinstance(identified, StateSpaceModel):
        uncertainty, search = uncertainty or identified.uncertainty, search or identified.search
    controller, plant = controller or loop.controller, plant or loop.plant
    return _validate(
        model, loop.data, controller, uncertainty=uncertainty, plant=plant, search=search, horizons=horizons, lags=lags
    )


def _validate(
    model: StateSpaceModel,
    data: IdentificationData,
    controller: KnownController | None,
    *,
    uncertainty: ModelUncertainty | None,
    plant: PlantParameters | None,
    search: SearchEnd | None,
    horizons: Sequence[int] | None,
    lags: int,
) -> Validation:
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
        loop = _closed_loop(model, data, controller, prediction)
        known = controller if loop.closed_loop is not None else None
        errors = response_errors(model, data, prediction.residuals, known, open_loop=in_open_loop(data))
        deviations = find_deviations(model, data, prediction, known)
        ringing = find_ringing(
            prediction.residuals,
            [item.inputs for item in data.experiments],
            [item.outputs for item in data.experiments],
            data.sample_time,
            1.0 + (data.samples / model.samples if model.samples else 0.0),
        )
        frequency, frequency_notes = compare_responses(model, data, controller, uncertainty, plant)
    findings = tuple(check_recording(data))
    noted = [f"{one.check}: {one.text}" for one in findings if one.check == NOTED and one.severity is not Severity.INFO]
    return Validation(
        model,
        data,
        tuple(sorted({1, *horizons})),
        prediction,
        residuals,
        loop.closed_loop,
        frequency,
        evidence_of(data),
        (*loop.notes, *noted, *frequency_notes),
        _controller_check(data, controller, loop),
        findings,
        band_errors=errors,
        deviations=deviations,
        ringing=ringing,
        possible_fit=loop.possible,
        without_loop=loop.missing,
        overlap=overlap(model.fingerprint, data),
        search=search,
        undecided=uncertainty.at_one if uncertainty is not None else None,
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


@dataclass(frozen=True, eq=False)
class _Loop:
    """The closed loop of the experiments with a known reference, or why it is missing."""

    closed_loop: ClosedLoop | None = None
    possible: PossibleFit | None = None
    missing: str = ""
    notes: tuple[str, ...] = ()


def _closed_loop(
    model: StateSpaceModel, data: IdentificationData, controller: KnownController | None, prediction: Prediction
) -> _Loop:
    if controller is None:
        return _Loop(missing="the controller is not known")
    if not suits_controller(data):
        return _Loop(missing="the units of the data are not those of a loop, A and m")
    known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
    if not known:
        return _Loop(missing="the data have no reference")
    notes = []
    if unknown := len(data.experiments) - len(known):
        notes.append(f"closed loop: {unknown} experiment{'s' if unknown > 1 else ''} without reference left out")
    measured = [data.record(index) for index in known]
    found = check_closed_loop(model, controller, measured, prediction.first_states[known])
    residuals = [prediction.residuals[index] for index in known]
    return _Loop(found, possible_fit(model, controller, measured, residuals), "", tuple(notes))


def _controller_check(data: IdentificationData, controller: KnownController | None, loop: _Loop) -> Finding:
    """Whether this is the controller of the currents, where a loop can be closed at all."""
    if loop.missing:
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: {loop.missing}")
    return check_controller(data, controller)
