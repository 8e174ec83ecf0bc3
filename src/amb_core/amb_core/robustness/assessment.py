"""All numbers of the robustness of a loop: peaks, zones, margins, structured singular value, and their 99 % bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from amb_core.ground.errors import RobustnessError
from amb_core.ground.given_values import require_kind
from amb_core.ground.parameters import given_set
from amb_core.identification.given import OF_UNCERTAINTY, Controller, given_model, required_controller
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.linear import Arrays, LinearSystem, rates_of
from amb_core.linear.model import StateSpaceModel
from amb_core.linear.numerics import one_blas_thread
from amb_core.linear.peak import Peak, peak_gain
from amb_core.robustness.ellipsoid import Worst
from amb_core.robustness.feedback import Feedback, feedback_of
from amb_core.robustness.known_band import KnownBand
from amb_core.robustness.late_plant import late_uncertainty
from amb_core.robustness.margins import (
    ClassicalMargins,
    DiskMargin,
    classical_margins,
    disk_margin_of_axis,
    disk_margins,
    reciprocal,
)
from amb_core.robustness.mu import MuPeak, mu_peak
from amb_core.robustness.replay import distance_from_circle
from amb_core.robustness.settings import ZONES, RobustnessSettings, Zone, zone_of
from amb_core.robustness.structure import UncertainLoop, uncertain_loop
from amb_core.robustness.worst_cases import AxisBounds, Gap, PoleBounds, WorstCases

LOWEST = 1e-4  # of half the sample rate, where the curves start
_AT_REST = 0.01  # of the slowest pole of the loop, where they start if it is slower: the response there is that of 0 Hz
_PER_DECADE = 20  # frequencies of these slow ones, at which the response changes little


@dataclass(frozen=True)
class AxisResult:
    """Sensitivity of one axis, all other loops closed.

    Attributes
    ----------
    name : str
        The axis.
    sensitivity, complementary : Peak
        Peaks of the magnitudes of S and T.
    margins : ClassicalMargins
        Gain, phase and delay.
    disk : DiskMargin
        Of this axis alone.
    zone : str
        Zone after ISO 14839-3 of the model's peak.
    """

    name: str
    sensitivity: Peak
    complementary: Peak
    margins: ClassicalMargins
    disk: DiskMargin
    zone: Zone


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the data leave open: models of the ellipsoid, and plants that differ from them within the error band.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz) of the curves, of which something is stated.
    axes : tuple of AxisBounds
        By axis.
    outputs, all_signals : Worst
        Bound of mu of the disk margin of all outputs, and of the perturbations at all signals of the settings.
    gap : Gap
        nu-gap.
    poles : tuple of PoleBounds
        Unstable poles, fastest first; of two complex conjugate ones that in the upper half plane.
    small_gain : float
        Largest ||D|| ||C S|| of an error D within the band and a model of the ellipsoid; below 1 no such error makes
        the loop unstable.
    small_gain_frequency : float
        Where it is (Hz).
    """

    frequency: Arrays
    axes: tuple[AxisBounds, ...]
    outputs: Worst
    all_signals: Worst | None
    gap: Gap
    poles: tuple[PoleBounds, ...]
    small_gain: float
    small_gain_frequency: float

    def beyond_limits(self, settings: RobustnessSettings) -> list[Worst]:
        """The largest sensitivity where its zone is not the one needed, and the bound of mu where it is 1 or more."""
        worst = max((axis.sensitivity for axis in self.axes), key=lambda one: one.value)
        zone = zone_of(worst.value, settings.sensitivity_limits)
        beyond = [worst] if ZONES.index(zone) > ZONES.index(settings.needed_zone) else []
        if self.all_signals is not None and self.all_signals.value >= 1.0:
            beyond.append(self.all_signals)
        return beyond


@dataclass(frozen=True, eq=False)
class Assessment:
    """The robustness of a stable loop.

    Attributes
    ----------
    feedback : Feedback
        The loop.
    settings : RobustnessSettings
        What was assumed.
    frequency : ndarray, shape (f,)
        Frequencies of the curves (Hz).
    axes : tuple of AxisResult
        By axis.
    sensitivity, complementary : Peak
        Largest singular values of S and T over all axes together.
    disks : tuple of DiskMargin
        At all outputs, all inputs, both.
    uncertain : UncertainLoop
        Perturbations of the settings.
    mu : MuPeak
        Structured singular value for them; the loop tolerates all of them together if it is below 1.
    on_circle : float
        Distance from the unit circle of the pole of the replayed worst case (-).
    bounds : Bounds or None
        By the covariance of the model, if it is known.
    """

    feedback: Feedback
    settings: RobustnessSettings
    frequency: Arrays
    axes: tuple[AxisResult, ...]
    sensitivity: Peak
    complementary: Peak
    disks: tuple[DiskMargin, ...]
    uncertain: UncertainLoop
    mu: MuPeak
    on_circle: float
    bounds: Bounds | None


def assess(
    model: StateSpaceModel,
    controller: Controller,
    settings: RobustnessSettings | None = None,
    uncertainty: ModelUncertainty | None = None,
) -> Assessment:
    """The robustness of the loop of a model and a controller.

    Parameters
    ----------
    model : StateSpaceModel
        Identified model without feedthrough.
    controller : KnownController, LinearSystem, control.StateSpace or str
        The PD controller or any linear one; limits are left out.
    settings : RobustnessSettings, optional
        What is assumed; the defaults if None.
    uncertainty : ModelUncertainty, optional
        Covariance of the model; without it there are no bounds of it.

    Returns
    -------
    Assessment
        Margins, peaks and structured singular value.

    Raises
    ------
    RobustnessError
        If the loop is not stable (the message names the pole), or something else makes margins meaningless.
    IdentificationError, ParameterError
        If model and controller do not fit together.
    """
    settings = given_set(RobustnessSettings, "settings", settings)
    model = given_model(model)
    require_kind("uncertainty", uncertainty, (ModelUncertainty, type(None)), OF_UNCERTAINTY, RobustnessError)
    law = required_controller(controller, model.sample_time)
    return assess_loop(feedback_of(model, law, settings.extra_delay), settings, uncertainty)


def assess_loop(
    feedback: Feedback,
    settings: RobustnessSettings,
    uncertainty: ModelUncertainty | None = None,
    known: KnownBand | None = None,
) -> Assessment:
    """The same for a loop that is formed already; its bounds hold in the known band, and count what is open there.

    Parameters
    ----------
    feedback : Feedback
        A stable loop.
    settings : RobustnessSettings
        What is assumed.
    uncertainty : ModelUncertainty, optional
        Covariance of the model; without it there are no bounds of it.
    known : KnownBand, optional
        Frequencies of which the data say something; all if None.

    Returns
    -------
    Assessment
        Margins, peaks and structured singular value.

    Raises
    ------
    RobustnessError
        If the loop is not stable, or something else makes margins meaningless.
    """
    feedback.require_stable()
    if uncertainty is not None:
        uncertainty = late_uncertainty(uncertainty, settings.extra_delay % 1.0)
    with one_blas_thread():  # the matrices are small
        margins = classical_margins(feedback)
        axes = tuple(_axis(feedback, axis, item, settings) for axis, item in enumerate(margins))
        frequency = _grid(feedback, axes, round(settings.frequencies))
        uncertain = uncertain_loop(feedback, settings)
        mu = mu_peak(uncertain.system, uncertain.blocks, frequency)
        replayed = len(mu.perturbation) > 0
        return Assessment(
            feedback,
            settings,
            frequency,
            axes,
            peak_gain(feedback.output_sensitivity),
            peak_gain(feedback.complementary),
            disk_margins(feedback, frequency, settings.skew),
            uncertain,
            mu,
            distance_from_circle(uncertain.system, mu.perturbation, mu.lower_frequency) if replayed else math.nan,
            None
            if uncertainty is None or (known is not None and known.empty)
            else _bounds(feedback, settings, uncertainty, frequency, axes, uncertain, known),
        )


def assess_known(
    feedback: Feedback, settings: RobustnessSettings, uncertainty: ModelUncertainty | None, known: KnownBand
) -> tuple[Assessment, KnownBand]:
    """The same, without what is assumed above the data where that alone leaves bounds beyond their limits.

    The assumptions may keep the loop stable and say little of its sensitivity and of its perturbations. The data's own
    band is stated then, as where the assumptions do not keep it stable: milder ones never state less.

    Parameters
    ----------
    feedback : Feedback
        A stable loop.
    settings : RobustnessSettings
        What is assumed and demanded.
    uncertainty : ModelUncertainty or None
        Covariance of the model; without it there are no bounds of it.
    known : KnownBand
        Frequencies of which data and assumptions say something.

    Returns
    -------
    tuple of Assessment and KnownBand
        The assessment, and the frequencies of which it speaks.
    """
    whole = assess_loop(feedback, settings, uncertainty, known)
    if whole.bounds is None or not known.reaches_up:
        return whole, known
    beyond = whole.bounds.beyond_limits(settings)
    if not beyond or min(worst.frequency for worst in beyond) <= known.high:
        return whole, known
    inside = replace(known, reaches_up=False)
    return assess_loop(feedback, settings, uncertainty, inside), inside


def _axis(feedback: Feedback, axis: int, margins: ClassicalMargins, settings: RobustnessSettings) -> AxisResult:
    one = [feedback.inputs + axis]
    sensitivity = peak_gain(feedback.closed.part(one, one))
    return AxisResult(
        feedback.axes[axis],
        sensitivity,
        peak_gain(feedback.complementary.part([axis], [axis])),
        margins,
        disk_margin_of_axis(feedback, axis, settings.skew),
        zone_of(sensitivity.value, settings.sensitivity_limits),
    )


def _stated_peaks(axis: AxisResult, known: KnownBand | None) -> tuple[Peak, Peak, Peak]:
    """Exact peaks of S, T and S + (sigma - 1) / 2 of the model; 0 where nothing is stated at their frequency."""

    def stated(value: float, frequency: float) -> Peak:
        holds = known is None or bool(known.holds(np.array(frequency)))
        return Peak(value if holds else 0.0, frequency)

    return (
        stated(axis.sensitivity.value, axis.sensitivity.frequency),
        stated(axis.complementary.value, axis.complementary.frequency),
        stated(reciprocal(axis.disk.guaranteed), axis.disk.frequency),
    )


def _grid(feedback: Feedback, axes: Sequence[AxisResult], count: int) -> Arrays:
    """Even in the logarithm, with further frequencies at the peaks and at the poles of the loop, and at slow ones."""
    half = 0.5 / feedback.plant.sample_time
    lowest = min(LOWEST * half, _AT_REST * _slowest(feedback.closed))
    slow = np.geomspace(lowest, LOWEST * half, math.ceil(_PER_DECADE * math.log10(LOWEST * half / lowest)), False)
    angles = np.angle(feedback.closed.poles())
    special = [*(angles[angles > 0.0] / np.pi * half), *(axis.sensitivity.frequency for axis in axes)]
    near = [at * np.linspace(0.97, 1.03, 5) for at in special if at > lowest]
    even = max(count - 5 * len(near), count // 2)  # a long delay has many poles
    grid = np.concatenate([slow, np.geomspace(LOWEST * half, half * (1.0 - 1e-9), even), *near])
    return np.unique(np.clip(grid, lowest, half * (1.0 - 1e-9)))


def _slowest(closed: LinearSystem) -> float:
    """Natural frequency of the slowest pole of a loop (Hz); infinite without poles."""
    rates = rates_of(closed.poles(), closed.sample_time)
    return float(np.min(np.abs(rates), initial=math.inf)) / (2.0 * math.pi)


def _bounds(
    feedback: Feedback,
    settings: RobustnessSettings,
    uncertainty: ModelUncertainty,
    frequency: Arrays,
    axes: Sequence[AxisResult],
    uncertain: UncertainLoop,
    known: KnownBand | None,
) -> Bounds:
    if known is not None:
        ends = np.array([known.low, known.high])  # a narrow band may hold no other frequency
        frequency = np.unique(np.concatenate([frequency[known.holds(frequency)], ends]))
    search = WorstCases.of(feedback, uncertainty, frequency, settings, known)
    by_axis = tuple(search.axis(axis, result.name) for axis, result in enumerate(axes))
    possible = all(math.isfinite(one.replayed) or one.excluded for one in by_axis)
    if known is not None and possible and not all(one.linear for one in by_axis):
        search = WorstCases.of(feedback, uncertainty, frequency, settings, known, by_data=True)
        by_axis = tuple(search.axis_by_data(axis, one) for axis, one in enumerate(by_axis))
    own = [_stated_peaks(result, known) for result in axes]
    by_axis = tuple(one.at_least(*peaks, settings) for one, peaks in zip(by_axis, own, strict=True))
    m, size = feedback.inputs, feedback.outputs
    into = np.eye(size, m + size, m)
    outputs = search.scaled(into, into.T, 0.5 * (settings.skew - 1.0) * np.eye(size))
    for *_, disk in own:
        outputs = outputs.at_least(disk)
    signals = search.scaled(uncertain.out, uncertain.into, uncertain.direct) if len(uncertain.direct) else None
    small_gain, at = search.small_gain()
    if small_gain >= 1.0:
        by_axis = tuple(axis.unbounded() for axis in by_axis)
    if any(math.isinf(axis.sensitivity.value) for axis in by_axis):
        outputs = replace(outputs, value=math.inf)
        signals = None if signals is None else replace(signals, value=math.inf)
    return Bounds(frequency, by_axis, outputs, signals, search.gap(), search.poles(), small_gain, at)
