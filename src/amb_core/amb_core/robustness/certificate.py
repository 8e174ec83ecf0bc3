"""The certificate: what was checked, what was found, and whether every check passed.

The word certified stands only where every check passed. A loop that is not stable ends at that check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.tones import without_unanswered
from amb_core.ground.errors import RobustnessError
from amb_core.ground.parameters import given_set
from amb_core.ground.results import Result
from amb_core.identification.given import Controller, given_model, required_controller
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.identification.validation import Validation, Verdict
from amb_core.linear.model import StateSpaceModel
from amb_core.linear.numerics import one_blas_thread
from amb_core.robustness.assessment import Assessment, Bounds, assess_known, assess_loop
from amb_core.robustness.checks import (
    COVERED,
    MEASURED,
    NOT_RUN,
    Check,
    amplitude_check,
    assumption_check,
    band_checks,
    displacement_check,
    measured_checks,
    measured_peak_check,
    was_measured_check,
)
from amb_core.robustness.error_band import error_band
from amb_core.robustness.feedback import Feedback, feedback_of
from amb_core.robustness.given_results import require_of_model, require_results
from amb_core.robustness.known_band import KnownBand, known_band
from amb_core.robustness.measured import MeasuredSensitivity
from amb_core.robustness.settings import ZONES, RobustnessSettings, Zone, zone_of
from amb_core.robustness.trace import Trace
from amb_core.robustness.worst_cases import FAR, AxisBounds

ON_CIRCLE = 1e-6  # distance of the replayed pole from the unit circle at most
WIDE_GAP = 0.1  # of the bounds of mu, relative, from which the finding names it
Statement = Literal["certified", "certified with reservations", "predicted", "restricted", "not certified"]
_OF_NOISE = ("ringing", "whiteness", "independence")  # conditions of a validation by which noise shows dynamics
FARTHEST = 30.0  # of a model from the best one of its data, in standard deviations


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Result):
    """The result for a model and a controller.

    Attributes
    ----------
    checks : tuple of Check
        In order; the first that fails is the reason of a refusal.
    assessment : Assessment or None
        All numbers; None for an unstable loop.
    settings : RobustnessSettings
        What was assumed and demanded.
    warnings : tuple of str
        What does not refuse the certificate but must be known.
    inputs : mapping
        Name and SHA-256 of everything that was read.
    measured : MeasuredSensitivity or None
        Measured sensitivity, for comparison; None if none was measured.
    displacement : mapping of str to Zone, or None
        Zone after ISO 14839-2 of each axis; None if displacement or clearance is not known.
    reserved : bool
        Whether the model is validated with reservations only.
    known : KnownBand or None
        The frequencies of which something is stated; None without data.
    amplitude : mapping of str to float, or None
        Largest motion from the middle in the data by axis (m); None without data.
    trace : Trace or None
        Where it comes from, if it was made from files; None otherwise.
    """

    checks: tuple[Check, ...]
    assessment: Assessment | None
    settings: RobustnessSettings
    warnings: tuple[str, ...]
    inputs: Mapping[str, str]
    measured: MeasuredSensitivity | None = None
    displacement: Mapping[str, Zone] | None = None
    reserved: bool = False
    known: KnownBand | None = None
    amplitude: Mapping[str, float] | None = None
    trace: Trace | None = None

    @property
    def certified(self) -> bool:
        """Whether every check passed, with or without reservations on the model: `statement` shows which."""
        return self.statement.startswith("certified")

    @property
    def statement(self) -> Statement:
        """How much is stated."""
        failed = {check.name for check in self.checks if not check.passed}
        if failed - {COVERED, MEASURED} or self.assessment is None or self.assessment.bounds is None:
            return "not certified"
        if COVERED in failed:
            return "restricted"
        if MEASURED in failed:
            return "predicted"
        return "certified with reservations" if self.reserved else "certified"

    @property
    def verdict(self) -> str:
        """One sentence; the bare word certified only where the model is validated without reservation."""
        failed = {check.name: check.finding for check in self.checks if not check.passed}
        statement = self.statement
        if statement == "not certified":
            return f"Not certified: {'; '.join(failed.values())}.{self._own_terms}"
        if statement == "restricted":
            only = ", predicted only" if MEASURED in failed else ""
            return f"Not certified as a whole{only}: {failed[COVERED]}.{self._own_terms}"
        assert self.assessment is not None
        assert self.assessment.bounds is not None
        zone = max((item.zone for item in self.assessment.bounds.axes), key=ZONES.index)
        percent = f"{100.0 * self.settings.confidence:g} %"
        words = {
            "certified": "Certified",
            "certified with reservations": "Certified with reservations on the model",
            "predicted": f"Predicted, not certified, since {failed.get(MEASURED)}",
        }
        return (
            f"{words[statement]}: stable, zone {zone} after ISO 14839-3 with {percent}, and stable under all assumed "
            f"perturbations together.{self._own_terms}"
        )

    @property
    def summary(self) -> str:
        """The verdict."""
        return self.verdict

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The checks with their findings, those that do not hold first."""
        ordered = sorted(self.checks, key=lambda check: check.passed)
        return [(check.name, f"{'' if check.passed else 'not passed: '}{check.finding}") for check in ordered]

    @property
    def _own_terms(self) -> str:
        """What was demanded otherwise than usual, as a sentence after the verdict."""
        return f" By the user's own limits: {self.settings.own_terms}." if self.settings.own_terms else ""


def certify(
    model: StateSpaceModel,
    controller: Controller,
    *,
    settings: RobustnessSettings | None = None,
    validation: Validation | None = None,
    uncertainty: ModelUncertainty | None = None,
    inputs: Mapping[str, str] | None = None,
    measured: MeasuredSensitivity | None = None,
    displacement: Mapping[str, float] | None = None,
    records: Sequence[IdentificationData] = (),
    not_measured: str = NOT_RUN,
) -> Certificate:
    """Check a model and a controller.

    Parameters
    ----------
    model : StateSpaceModel
        The identified model.
    controller : KnownController, LinearSystem, control.StateSpace or str
        The controller that is to run; it may differ from that of the experiment.
    settings : RobustnessSettings, optional
        What is assumed and demanded. The defaults if None.
    validation : Validation, optional
        Of the model; without it there is no certificate.
    uncertainty : ModelUncertainty, optional
        Of the model; without it there is no certificate.
    inputs : mapping, optional
        Name and SHA-256 of what was read. None for nothing.
    measured : MeasuredSensitivity, optional
        For comparison. None if none was measured.
    displacement : mapping of str to float, optional
        Largest displacement over clearance of each axis (-). Without it no zone after ISO 14839-2 is given.
    records : sequence of IdentificationData, optional
        Data that show the error of the model, in addition to those of the validation.
    not_measured : str, optional
        Why there is no `measured`: without it the numbers are predicted, not certified.

    Returns
    -------
    Certificate
        The checks with their verdict, and all numbers of the loop.

    Raises
    ------
    IdentificationError, ParameterError, RobustnessError
        If model and controller do not fit together, limits of zones do not rise, or validation or uncertainty are of
        another model.
    """
    settings = given_set(RobustnessSettings, "settings", settings)
    require_results(validation, uncertainty)
    model = given_model(model)
    require_of_model(model, validation, uncertainty)
    law = required_controller(controller, model.sample_time)
    checks = [_validated(validation)]
    feedback = feedback_of(model, law, settings.extra_delay)
    assessment: Assessment | None = None
    known: KnownBand | None = None
    try:
        feedback.require_stable()
        checks.append(Check("the loop is stable", True, "all poles lie inside the unit circle"))
    except RobustnessError as problem:
        checks = [Check("the loop is stable", False, str(problem))]
    else:
        known = _known(feedback, validation, records, settings)
        if known is None:
            assessment = assess_loop(feedback, settings, uncertainty)
        else:
            assessment, known = assess_known(feedback, settings, uncertainty, known)
        checks += _checks(assessment, uncertainty, known)
        if measured is not None and assessment.bounds is not None:
            checks += measured_checks(measured, assessment, settings)
    if measured is not None and measured.checked:
        checks.append(measured_peak_check(measured, settings))
    zones = {name: zone_of(value, settings.displacement_limits) for name, value in (displacement or {}).items()}
    if zones:
        checks.append(displacement_check(zones, settings))
    amplitude = {} if validation is None else _amplitude([*records, validation.data])
    if settings.operation_amplitude and amplitude:
        checks.append(amplitude_check(amplitude, settings))
    if assessment is not None:
        checks.append(was_measured_check(measured, assessment, not_measured))
    warnings = _warnings(validation, uncertainty) + _not_linear(assessment)
    if amplitude and not settings.operation_amplitude:
        warnings += (_motion_not_compared(amplitude),)
    reserved = validation is not None and validation.verdict is not Verdict.VALIDATED
    return Certificate(
        tuple(checks), assessment, settings, warnings, dict(inputs or {}), measured, zones, reserved, known, amplitude,
    )  # fmt: skip


def _known(
    feedback: Feedback,
    validation: Validation | None,
    records: Sequence[IdentificationData],
    settings: RobustnessSettings,
) -> KnownBand | None:
    """What the data of validation and identification say of the loop by frequency; None without data."""
    if validation is None:
        return None
    with one_blas_thread():
        data = [*map(without_unanswered, records), validation.data]
        band = error_band(
            validation.model, data, settings.mode_damping, settings.mode_ring_down, action=feedback.action
        )
        explained = all(item.level is Verdict.VALIDATED for item in validation.conditions if item.key in _OF_NOISE)
        return known_band(feedback, band, settings, explained)


def _amplitude(records: Sequence[IdentificationData]) -> dict[str, float]:
    """Largest motion of each axis from its middle (m)."""
    motions = [np.ptp(item.outputs, axis=0) for data in records for item in data.experiments]
    return dict(zip(records[0].output_names, (0.5 * np.max(motions, axis=0)).tolist(), strict=True))


def _validated(validation: Validation | None) -> Check:
    name = "the model is validated"
    if validation is None:
        return Check(name, False, "the model was not validated; give the bag of its data (bag)")
    if validation.closed_loop is None:
        return Check(name, False, f"its closed loop could not be validated: {validation.without_loop}")
    return Check(name, validation.validated, validation.summary)


def _checks(assessment: Assessment, uncertainty: ModelUncertainty | None, known: KnownBand | None) -> list[Check]:
    checks = _perturbation_checks(assessment)
    if uncertainty is None:
        return [*checks, Check("the uncertainty of the model is known", False, "no data of the model are given")]
    if known is not None:
        checks += [
            *band_checks(assessment, known),
            assumption_check(assessment.feedback, uncertainty, known, assessment.settings),
        ]
    if assessment.bounds is not None:
        checks += _ellipsoid_checks(assessment.bounds, uncertainty, assessment.settings)
    return checks


def _perturbation_checks(assessment: Assessment) -> list[Check]:
    """What the loop of the model itself tolerates."""
    mu = assessment.mu
    reach = f"up to {1.0 / mu.upper:.2f} times" if mu.upper else "with any size of"
    return [
        Check(
            "all assumed perturbations together leave the loop stable",
            mu.upper < 1.0,
            f"structured singular value between {mu.lower:.3f} and {mu.upper:.3f} at {mu.frequency:.4g} Hz: stable "
            f"{reach} the assumed perturbations"
            + (f"; the bounds are {100.0 * mu.gap:.0f} % apart, the upper one counts" if mu.gap > WIDE_GAP else ""),
        ),
        Check(
            "the replayed worst case puts a pole on the unit circle",
            not mu.lower or assessment.on_circle < ON_CIRCLE,
            f"distance {assessment.on_circle:.1g} at {mu.lower_frequency:.4g} Hz"
            if mu.lower
            else "no perturbation was found that makes the loop unstable",
        ),
    ]


def _ellipsoid_checks(bounds: Bounds, uncertainty: ModelUncertainty, settings: RobustnessSettings) -> list[Check]:
    """What the models that the data allow say of the loop."""
    percent = f"{100.0 * settings.confidence:g} %"
    worst = max(bounds.axes, key=lambda item: item.sensitivity.value)
    zone = max((item.zone for item in bounds.axes), key=ZONES.index)
    undecided = uncertainty.at_one
    checks = [
        Check("the data decide which poles of the plant are stable", not undecided, undecided or "they do"),
        Check(
            "the model is the one that explains its data best",
            uncertainty.distance <= FARTHEST,
            f"{uncertainty.distance:.2g} standard deviations away; allowed: {FARTHEST:g}"
            + (", and the bounds are as much wider" if uncertainty.distance > FAR else ""),
        ),
        Check(
            f"zone {settings.needed_zone} or better after ISO 14839-3 with {percent}",
            ZONES.index(zone) <= ZONES.index(settings.needed_zone),
            f"peak sensitivity of axis {worst.name} at most {worst.sensitivity.value:.3f} with {percent}, at "
            f"{worst.sensitivity.frequency:.4g} Hz: zone {zone}" + _share(worst),
        ),
        Check(
            "the worst models of the ellipsoid make stable loops, as far as the data reach",
            all(math.isfinite(item.replayed) or item.excluded for item in bounds.axes),
            ", ".join(_replayed(item) for item in bounds.axes),
        ),
    ]
    if bounds.all_signals is not None:
        value = bounds.all_signals.value
        text = f"bound of mu {value:.3f} with {percent}, real perturbations taken as complex, without bending modes"
        checks.append(Check("perturbations at the signals and models of the ellipsoid together", value < 1.0, text))
    return checks


def _replayed(axis: AxisBounds) -> str:
    """The peak of the worst model of the ellipsoid."""
    text = f"{axis.name}: peak {axis.replayed:.3f}"
    if axis.unstable_above:
        return text + " in the band of the data; modes of the model above it are unstable, what is assumed counts there"
    return text + (" of a model that the data exclude" if axis.excluded else "")


def _share(worst: AxisBounds) -> str:
    """What makes a bound: the models of the ellipsoid, the rest of the response's error, or a response not linear."""
    if worst.by_data:
        return f" (by the error of the response that the data leave open; the worst model has {_replayed(worst)})"
    if not math.isfinite(worst.replayed):
        return ""
    text = f" (models alone {worst.of_ellipsoid:.3f}, the worst of them as a model {worst.replayed:.3f}"
    text += " in the band of the data" if worst.unstable_above else ""
    return text + (")" if worst.linear else "; the response is not linear in their parameters)")


def _warnings(validation: Validation | None, uncertainty: ModelUncertainty | None) -> tuple[str, ...]:
    warnings = []
    if uncertainty is not None and not uncertainty.white:
        warnings.append(
            f"the innovations scatter {uncertainty.inflation:.3g} times as much as white ones would: the order is too "
            "low or the data were not those of a linear plant; "
            + ("bounds use the measured scatter" if uncertainty.robust else "bounds are too narrow")
        )
    if validation is not None:
        warnings += [f"reservation on the model: {one.name}: {one.finding}" for one in validation.failed]
        warnings.append(f"linearity of the data: {validation.evidence.brief}")
    return tuple(warnings)


def _motion_not_compared(amplitude: Mapping[str, float]) -> str:
    """That nobody said how far the bearing moves in operation, and how far it does in the data."""
    largest = ", ".join(f"{name} {1e6 * value:.3g} um" for name, value in amplitude.items())
    return (
        f"the data move at most {largest} from the middle; the motion in operation is not given (operation_amplitude), "
        "so whether the data reach as far was not checked"
    )


def _not_linear(assessment: Assessment | None) -> tuple[str, ...]:
    """Where the response is not linear in the parameters over the ellipsoid, so a bound is not that of a model."""
    if assessment is None or assessment.bounds is None:
        return ()
    return tuple(
        f"axis {one.name}: the models of the ellipsoid reach {one.of_ellipsoid:.3f} if their response is taken as "
        f"linear in the parameters, and {one.replayed:.3f} as models: the data leave the parameters so uncertain; "
        + ("the bounds are those of the response itself" if one.by_data else "take more data, or lower the order")
        for one in assessment.bounds.axes
        if (math.isfinite(one.replayed) or one.by_data) and not one.linear
    )
