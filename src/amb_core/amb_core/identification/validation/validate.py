"""One call from a model and data to a verdict: prediction, residuals, closed loop and frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.data.controller_choice import suits_controller
from amb_core.data.experiments import Finding, IdentificationData, Severity, restore
from amb_core.data.experiments.checks import check_recording, evidence_of
from amb_core.data.experiments.tones import cure_tones
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind, whole_number, whole_numbers
from amb_core.ground.sample_times import difference, same_sample_time
from amb_core.identification.closed_loop import closed_loop_poles
from amb_core.identification.controller_check import NOT_CHECKED, added_constant, check_controller
from amb_core.identification.given import (
    OF_UNCERTAINTY,
    Controller,
    Data,
    Model,
    given_controller,
    given_loop,
    given_model,
    is_identified,
)
from amb_core.identification.prediction import Prediction, predict
from amb_core.identification.progress import SearchEnd
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty
from amb_core.identification.validation.deviations import effects_of, find_deviations
from amb_core.identification.validation.drift import levelled, undrifted
from amb_core.identification.validation.frequency import compare_responses, in_open_loop
from amb_core.identification.validation.judge import NOTED
from amb_core.identification.validation.model_error import response_errors, variance_of_estimate
from amb_core.identification.validation.noise_model import with_noise_model
from amb_core.identification.validation.overlap import overlap
from amb_core.identification.validation.possible import PossibleFit, possible_fit
from amb_core.identification.validation.residuals import LAGS, check_residuals
from amb_core.identification.validation.ringing import LONGEST, Ringing, find_ringing
from amb_core.identification.validation.simulation import ClosedLoop, check_closed_loop
from amb_core.identification.validation.undisturbed import Undisturbed, undisturbed
from amb_core.identification.validation.validation import Validation
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import one_blas_thread
from amb_core.loop.known_controller import KnownController

if TYPE_CHECKING:
    from amb_core.plant import PlantParameters

HORIZONS = (1, 5, 20, 100)


def validate(
    model: Model,
    data: Data,
    controller: Controller | None = None,
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
    model : StateSpaceModel, Identification, LinearSystem or control.StateSpace
        The model, or the result of its identification; or a plant of one's own from currents to positions, whose
        operating point then are the means of the data. A gain K must make a stable predictor; without one, K = 0, it is
        estimated from the data, which the verdict says.
    data : LoopRecord, IdentificationData or RecordedLoop
        Data with the model's signals and sample time; the last is what `amb_core.read` returns.
    controller : KnownController, LinearSystem, control.StateSpace or str, optional
        The controller of the experiments, or its name; by default that of a RecordedLoop. Without it the closed loop is
        left out.
    uncertainty : ModelUncertainty, optional
        Uncertainty of the model, for its frequency response; by default that of an Identification.
    plant : PlantParameters, optional
        The plant, if it is known, such as that of the simulator; by default that of a RecordedLoop.
    search : SearchEnd, optional
        How the search of the identification ended, if it is known; by default what the model holds of it.
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
    _require_kinds(uncertainty, plant, search)
    loop, identified = given_loop(data), model
    model = given_model(model, loop.data)
    if is_identified(identified):
        uncertainty, search = uncertainty or identified.uncertainty, search or identified.search
    law = given_controller(controller, loop.data.sample_time, loop.data) or loop.controller
    if horizons is not None:
        horizons = whole_numbers("horizons", horizons, IdentificationError)
    lags = whole_number("lags", lags, IdentificationError)
    plant = plant or loop.plant
    return _validate(
        model, loop.data, law, uncertainty=uncertainty, plant=plant, search=search, horizons=horizons, lags=lags
    )


def _require_kinds(uncertainty: object, plant: object, search: object) -> None:
    none = type(None)
    require_kind("uncertainty", uncertainty, (ModelUncertainty, none), OF_UNCERTAINTY, IdentificationError)
    require_kind("search", search, (SearchEnd, none), "a SearchEnd, or None", IdentificationError)
    if plant is not None:
        from amb_core.plant import PlantParameters  # loads a compiler

        require_kind("plant", plant, PlantParameters, "PlantParameters, or None", IdentificationError)


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
    recorded = restore(_fitting(data, model))
    cure = cure_tones(recorded)
    data = recorded if cure is None else cure.data
    drift = undrifted(data)
    data = data if drift is None else drift.data
    if horizons is None:
        shortest = min(item.steps for item in data.experiments)
        horizons = [horizon for horizon in HORIZONS if 2 * horizon <= shortest]
    if controller is not None:
        controller.require_axes(len(data.output_names))
    # The matrices are small: more BLAS threads cost time, and take cores from the control loop.
    with one_blas_thread():
        given, model = model, with_noise_model(model, data)
        constant = _added_constant(recorded, controller)
        in_model = constant is None or not _fits_without(model, data, constant)
        if constant is not None and not in_model:
            data = _without(data, constant)
            model = with_noise_model(given, data)
        if drift is not None:
            data = levelled(data, given, drift.size)
            model = with_noise_model(given, data)
        prediction = predict(model, data, horizons)
        references = [item.inputs if in_open_loop(data) else item.reference for item in data.experiments]
        quiet = [undisturbed(model, *pair) for pair in zip(prediction.residuals, references, strict=True)]
        residuals = check_residuals(
            prediction.residuals,
            [item.inputs for item in data.experiments],
            lags,
            model.order * (2 * len(model.c) + model.b.shape[1]) + (model.d.size if np.any(model.d) else 0),
            model.samples,
            ([one.errors for one in quiet], _from_first(data, quiet, "inputs")),
        )
        loop = _closed_loop(model, data, constant if in_model else None, controller, prediction)
        known = controller if loop.closed_loop is not None else None
        errors = response_errors(model, data, prediction.residuals, known, open_loop=in_open_loop(data))
        errors = tuple(band for band in errors if drift is None or band.low >= drift.corner)
        deviations = find_deviations(model, data, prediction, known)
        ringing = _ringing(model, data, prediction, quiet)
        frequency, frequency_notes = compare_responses(model, data, controller, uncertainty, plant)
    findings = (*check_recording(recorded), *(() if drift is None else (drift.finding,)))
    noted = [f"{one.check}: {one.text}" for one in findings if one.check == NOTED and one.severity is not Severity.INFO]
    return Validation(
        model,
        data,
        tuple(sorted({1, *horizons})),
        prediction,
        residuals,
        loop.closed_loop,
        frequency,
        evidence_of(data, cured=True),
        (*_constant_note(constant, in_model, data), *loop.notes, *noted, *frequency_notes),
        _controller_check(recorded, controller, loop),
        findings,
        band_errors=errors,
        deviations=deviations,
        ringing=ringing,
        possible_fit=loop.possible,
        without_loop=loop.missing,
        loop_poles=loop.poles,
        overlap=overlap(model.fingerprint, recorded),
        search=search or SearchEnd.of(model),
        undecided=uncertainty.at_one if uncertainty is not None else next(iter(model.undecided), None),
        tones=max(quiet, key=lambda one: len(one.errors)).tones,
        removed_tones=() if cure is None else cure.frequencies,
        noise_from_data=model is not given,
    )


def _added_constant(data: IdentificationData, controller: KnownController | None) -> NDArray[np.float64] | None:
    """The constant in the recorded currents (A) that their controller did not add, where that is known."""
    return None if controller is None or not suits_controller(data) else added_constant(data, controller)


def _without(data: IdentificationData, constant: NDArray[np.float64]) -> IdentificationData:
    """The data with currents as the controller computed them."""
    return replace(data, experiments=tuple(replace(item, inputs=item.inputs - constant) for item in data.experiments))


def _fits_without(model: StateSpaceModel, data: IdentificationData, constant: NDArray[np.float64]) -> bool:
    """Whether the model was identified from currents without a constant: its predictions are better without it."""
    sizes = []
    for one in (data, _without(data, constant)):
        errors = np.vstack(predict(model, one).residuals)
        sizes.append(np.linalg.slogdet(errors.T @ errors)[1])
    return bool(sizes[1] < sizes[0])


def _constant_note(constant: NDArray[np.float64] | None, in_model: bool, data: IdentificationData) -> tuple[str, ...]:
    if constant is None:
        return ()
    added = ", ".join(f"{name} {value:.3g} A" for name, value in zip(data.input_names, constant, strict=True) if value)
    what = "closed loop: simulated" if in_model else "all judged"
    beside = "" if in_model else "; that of the identification had none"
    return (f"{what} without the constant in the recorded currents, {added}{beside}",)


def _ringing(
    model: StateSpaceModel, data: IdentificationData, prediction: Prediction, quiet: Sequence[Undisturbed]
) -> Ringing | None:
    """What rings in the errors without tones, beside the deviations that are known by name."""
    return find_ringing(
        [one.errors for one in quiet],
        _from_first(data, quiet, "inputs"),
        _from_first(data, quiet, "outputs"),
        data.sample_time,
        variance_of_estimate(model, data),
        lambda index: effects_of(model, data, prediction, index, quiet[index].first + LONGEST)[quiet[index].first :],
    )


def _from_first(
    data: IdentificationData, quiet: Sequence[Undisturbed], signal: Literal["inputs", "outputs"]
) -> list[NDArray[np.float64]]:
    """A signal of each experiment, from the first sample that counts."""
    return [getattr(item, signal)[one.first :] for item, one in zip(data.experiments, quiet, strict=True)]


def _fitting(data: IdentificationData, model: StateSpaceModel) -> IdentificationData:
    """The data at the sample time of the model, if they suit it."""
    if not same_sample_time(data.sample_time, model.sample_time):
        raise IdentificationError(
            f"the data have a sample time of {data.sample_time:g} s, the model of {model.sample_time:g} s; "
            "a model can only be validated on data with its own sample time: "
            + difference(data.sample_time, model.sample_time)
        )
    for kind in ("input", "output"):
        mine, theirs = getattr(model, f"{kind}_names"), getattr(data, f"{kind}_names")
        if mine != theirs:
            raise IdentificationError(
                f"the data have the {kind}s {', '.join(theirs)}, the model {', '.join(mine)}; they must be the same"
            )
        units, others = getattr(model, f"{kind}_units"), getattr(data, f"{kind}_units")
        other = [
            (name, unit, mine)
            for name, mine, unit in zip(theirs, units, others, strict=True)
            if unit and mine and unit != mine
        ]
        if other:
            name, unit, own = other[0]
            raise IdentificationError(
                f"the {kind} {name} is in {unit} in the data and in {own} in the model; they must have the same units: "
                "convert the data, or identify from data in these units"
            )
    for index, item in enumerate(data.experiments):
        if not np.isfinite(item.signals).all():
            raise IdentificationError(
                f"experiment {index} holds values that are not finite; leave them out with --repair split (in Python: "
                "split_at_invalid)"
            )
    return replace(data, sample_time=model.sample_time)


@dataclass(frozen=True, eq=False)
class _Loop:
    """The closed loop of the experiments with a known reference, or why it is missing; its poles need no reference."""

    closed_loop: ClosedLoop | None = None
    poles: NDArray[np.complex128] | None = None
    possible: PossibleFit | None = None
    missing: str = ""
    notes: tuple[str, ...] = ()


def _closed_loop(
    model: StateSpaceModel,
    data: IdentificationData,
    constant: NDArray[np.float64] | None,
    controller: KnownController | None,
    prediction: Prediction,
) -> _Loop:
    """Close the loop; `constant` is the one in the recorded currents (A) that the offset of the model has, too."""
    if controller is None:
        return _Loop(missing="the controller is not known")
    if not suits_controller(data):
        return _Loop(missing="the units of the data are not those of a loop, A and m")
    known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
    if not known:
        return _Loop(poles=closed_loop_poles(model, controller), missing="the data have no reference")
    notes = []
    if unknown := len(data.experiments) - len(known):
        notes.append(f"closed loop: {unknown} experiment{'s' if unknown > 1 else ''} without reference left out")
    measured = [data.record(index) for index in known]
    if constant is not None:  # the currents reach the plant without it, as its operating point then does
        measured = [replace(record, current=record.current - constant) for record in measured]
        model = replace(model, input_offset=model.input_offset - constant)
    closed_loop = check_closed_loop(model, controller, measured, prediction.first_states[known])
    return _Loop(closed_loop, closed_loop.poles, possible_fit(measured), "", tuple(notes))


def _controller_check(data: IdentificationData, controller: KnownController | None, loop: _Loop) -> Finding:
    """Whether this is the controller of the currents, where a loop can be closed at all."""
    if loop.missing:
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: {loop.missing}")
    return check_controller(data, controller)
