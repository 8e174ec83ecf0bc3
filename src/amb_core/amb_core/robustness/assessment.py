"""All numbers of the robustness of a loop: peaks, zones, margins, structured singular value, and their 99 % bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from amb_core.identification.numerics import one_blas_thread
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.linear import Arrays, Complexes
from amb_core.linear.peak import Peak, peak_gain
from amb_core.loop.known_controller import KnownController
from amb_core.model import StateSpaceModel
from amb_core.robustness.ellipsoid import (
    PlantSet,
    Worst,
    closed_loop_objective,
    gap_objective,
    radius_of_all,
    radius_of_one,
)
from amb_core.robustness.feedback import Feedback, feedback_of
from amb_core.robustness.known_band import KnownBand
from amb_core.robustness.late_plant import late_uncertainty
from amb_core.robustness.margins import (
    ClassicalMargins,
    DiskMargin,
    classical_margins,
    disk_margin_of_axis,
    disk_margins,
)
from amb_core.robustness.mu import MuPeak, mu_peak
from amb_core.robustness.mu_upper import balancing
from amb_core.robustness.replay import distance_from_circle
from amb_core.robustness.settings import RobustnessSettings, Zone, zone_of
from amb_core.robustness.structure import UncertainLoop, uncertain_loop

LOWEST = 1e-4  # of half the sample rate, where the curves start
FAR = 2.0
"""Distance of a model from the best one of its data, in standard deviations, from which the ellipsoid is larger."""
_NEAR = 21  # further frequencies around each peak


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
class AxisBounds:
    """Bounds of the sensitivity of an axis by the covariance of the model.

    Attributes
    ----------
    name : str
        The axis.
    sensitivity, complementary, disk : Worst
        Largest magnitudes of S, T and S + (sigma - 1) / 2; each kind of bound holds for all axes together. Infinite
        where the worst model makes an unstable loop.
    sensitivity_of_all : Worst
        Largest magnitude of S over the ellipsoid that holds all parameters at once.
    zone : str
        Zone after ISO 14839-3 of the bound of S.
    replayed : float
        Peak of S of the worst model of the ellipsoid, as a model; infinite if its loop is not stable.
    of_ellipsoid : float
        Largest magnitude of S over the ellipsoid alone, without further errors of the response.
    """

    name: str
    sensitivity: Worst
    complementary: Worst
    disk: Worst
    sensitivity_of_all: Worst
    zone: Zone
    replayed: float
    of_ellipsoid: float

    def unbounded(self) -> AxisBounds:
        """The same where nothing bounds the sensitivity."""
        return replace(
            self,
            sensitivity=replace(self.sensitivity, value=math.inf),
            complementary=replace(self.complementary, value=math.inf),
            disk=replace(self.disk, value=math.inf),
            zone="D",
        )


@dataclass(frozen=True, eq=False)
class Gap:
    """Distance of the models of the ellipsoid, and the distance that the loop bears.

    Attributes
    ----------
    worst : Worst
        Worst-case nu-gap between the model and those of the ellipsoid of the response.
    margin : float
        b(P, C), in the scale that makes it largest: every plant with a smaller nu-gap is stabilised.
    scale : float
        Positions are multiplied by it (A/m).
    """

    worst: Worst
    margin: float
    scale: float


@dataclass(frozen=True, eq=False)
class PoleBounds:
    """Bounds of unstable poles of the plant.

    Attributes
    ----------
    poles : ndarray of complex, shape (r,)
        Estimated poles, z plane: one, or several that the data do not separate.
    lowest, highest : float
        Bounds of their magnitudes, which hold for all groups together.
    """

    poles: Complexes
    lowest: float
    highest: float


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
        Structured singular value for them; the loop bears all of them together if it is below 1.
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
    controller: KnownController,
    settings: RobustnessSettings | None = None,
    uncertainty: ModelUncertainty | None = None,
) -> Assessment:
    """The robustness of the loop of a model and a controller.

    Parameters
    ----------
    model : StateSpaceModel
        Identified model without feedthrough.
    controller : KnownController
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
    settings = settings or RobustnessSettings()
    return assess_loop(feedback_of(model, controller, settings.extra_delay), settings, uncertainty)


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


def _grid(feedback: Feedback, axes: Sequence[AxisResult], count: int) -> Arrays:
    """Even in the logarithm, with further frequencies at the peaks and at the poles of the loop."""
    half = 0.5 / feedback.plant.sample_time
    angles = np.angle(feedback.closed.poles())
    special = [*(angles[angles > 0.0] / np.pi * half), *(axis.sensitivity.frequency for axis in axes)]
    near = [at * np.linspace(0.97, 1.03, 5) for at in special if at > LOWEST * half]
    even = max(count - 5 * len(near), count // 2)  # a long delay has many poles
    grid = np.concatenate([np.geomspace(LOWEST * half, half * (1.0 - 1e-9), even), *near])
    return np.unique(np.clip(grid, LOWEST * half, half * (1.0 - 1e-9)))


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
    plants = plants_of(feedback, uncertainty, frequency, known)
    search = WorstCases(feedback, uncertainty, plants, settings, known)
    found = tuple(search.axis(axis, result.name) for axis, result in enumerate(axes))
    m, size = feedback.inputs, feedback.outputs
    into = np.eye(size, m + size, m)
    outputs = search.scaled(into, into.T, 0.5 * (settings.skew - 1.0) * np.eye(size))
    signals = search.scaled(uncertain.out, uncertain.into, uncertain.direct) if len(uncertain.direct) else None
    small_gain, at = search.small_gain()
    if small_gain >= 1.0:
        found = tuple(axis.unbounded() for axis in found)
    if any(math.isinf(axis.sensitivity.value) for axis in found):
        outputs = replace(outputs, value=math.inf)
        signals = None if signals is None else replace(signals, value=math.inf)
    return Bounds(frequency, found, outputs, signals, search.gap(), search.poles(), small_gain, at)


def plants_of(
    feedback: Feedback, uncertainty: ModelUncertainty, frequency: Arrays, known: KnownBand | None
) -> PlantSet:
    """The plants that data leave possible; above the known band those of the assumed class, whatever the model."""
    if known is None:
        return PlantSet.of(uncertainty, frequency)
    plants = PlantSet.of(uncertainty, frequency, known.error(feedback, frequency))
    inside = (frequency <= known.high)[:, np.newaxis, np.newaxis]
    return replace(plants, axes=plants.axes * inside)


@dataclass(frozen=True, eq=False)
class WorstCases:
    """Worst cases over the models of an estimate."""

    feedback: Feedback
    uncertainty: ModelUncertainty
    plants: PlantSet
    settings: RobustnessSettings
    known: KnownBand | None = None

    @property
    def _wider(self) -> float:
        """Factor of all radii: a model far from the best one of its data is as far from the truth."""
        return self.uncertainty.distance if self.uncertainty.distance > FAR else 1.0

    def axis(self, axis: int, name: str) -> AxisBounds:
        """Bounds of one axis."""
        confidence, count = self.settings.confidence, self.uncertainty.root.shape[1]
        one = self._wider * radius_of_one(confidence, self.feedback.outputs)
        whole = self._wider * radius_of_all(confidence, count)
        half = 0.5 * (self.settings.skew - 1.0)
        sensitivity, of_all = self._of_axis(axis, 0.0, one), self._of_axis(axis, 0.0, whole)
        of_models = self._of_axis(axis, 0.0, one, alone=True) if self.known is not None else sensitivity
        replayed = self._replayed(axis, of_models)
        complementary, disk = self._of_axis(axis, -1.0, one), self._of_axis(axis, half, one)
        if math.isinf(self._replayed(axis, of_all)):
            of_all = replace(of_all, value=math.inf)
        zone = zone_of(sensitivity.value, self.settings.sensitivity_limits)
        found = AxisBounds(name, sensitivity, complementary, disk, of_all, zone, replayed, of_models.value)
        # Beyond a model on the limit of stability the gain means nothing.
        return found.unbounded() if math.isinf(replayed) else found

    def small_gain(self) -> tuple[float, float]:
        """Largest ||D|| ||C S|| of the errors D and the models, and its frequency."""
        m, size = self.feedback.inputs, self.feedback.inputs + self.feedback.outputs
        both = np.eye(size)
        shift = np.zeros((m, size - m))
        objective = closed_loop_objective(self.feedback, self.plants.frequency, both[:m], both[:, m:], shift)
        action = self.plants.alone.worst(objective, self._wider * radius_of_one(self.settings.confidence)).curve
        gain = action * self.plants.error
        place = int(np.argmax(gain))
        return float(gain[place]), float(self.plants.frequency[place])

    def _replayed(self, axis: int, worst: Worst) -> float:
        """Peak of S of an axis with a worst model, infinite if its loop is not stable."""
        moved = self.feedback.with_plant(self.uncertainty.moved(worst.factors))
        part = [self.feedback.inputs + axis]
        return peak_gain(moved.closed.part(part, part)).value if moved.stable else math.inf

    def _of_axis(self, axis: int, plus: float, radius: float, alone: bool = False) -> Worst:
        """Worst |S + plus| of an axis, with the frequencies around the largest once more and closer.

        `alone`: of the models of the ellipsoid, without further errors.
        """
        row = np.zeros((1, self.feedback.inputs + self.feedback.outputs))
        row[0, self.feedback.inputs + axis] = 1.0

        def search(plants: PlantSet) -> Worst:
            shift, plants = np.array([[plus]]), plants.alone if alone else plants
            return plants.worst(closed_loop_objective(self.feedback, plants.frequency, row, row.T, shift), radius)

        rough = search(self.plants)
        place = int(np.searchsorted(self.plants.frequency, rough.frequency))
        low, high = max(place - 1, 0), min(place + 1, len(self.plants.frequency) - 1)
        near = np.linspace(float(self.plants.frequency[low]), float(self.plants.frequency[high]), _NEAR)
        fine = search(plants_of(self.feedback, self.uncertainty, near, self.known))
        if fine.value <= rough.value:
            return rough
        return Worst(fine.value, fine.frequency, rough.curve, fine.factors)

    def scaled(self, out: Arrays, into: Arrays, plus: Arrays) -> Worst:
        """Worst bound of mu of out H into + plus over independent complex perturbations, with the estimate's D."""
        nominal = out @ self.feedback.closed.response(self.plants.frequency) @ into + plus
        scale = balancing(nominal)
        left, right = scale[:, :, np.newaxis] * out, into / scale[:, np.newaxis, :]
        shift = scale[:, :, np.newaxis] * plus / scale[:, np.newaxis, :]
        objective = closed_loop_objective(self.feedback, self.plants.frequency, left, right, shift)
        return self.plants.worst(objective, self._wider * radius_of_one(self.settings.confidence))

    def gap(self) -> Gap:
        """Worst nu-gap to the estimate, and what the loop bears."""
        margin, scale = stability_margin(self.feedback, self.plants.frequency)
        parts = 2 * self.plants.nominal[0].size
        radius = self._wider * radius_of_all(self.settings.confidence, parts)
        return Gap(self.plants.worst(gap_objective(self.plants.nominal, scale), radius), margin, scale)

    def poles(self) -> tuple[PoleBounds, ...]:
        """Bounds of the unstable poles."""
        groups = self.uncertainty.unstable_poles
        radius = self._wider * radius_of_one(self.settings.confidence, max(len(groups), 1))
        return tuple(PoleBounds(group.poles, *group.magnitudes(radius)) for group in groups)


def stability_margin(feedback: Feedback, frequency: Arrays) -> tuple[float, float]:
    """b(P, C) in the scale of positions that makes it largest, and this scale (A/m).

    b = 1/||[1; P] S_i [1, -C]||_inf with k P and C/k for P and C.
    """
    m, p = feedback.inputs, feedback.outputs
    four_block = feedback.closed.plus(-np.diag(np.r_[np.zeros(m), np.ones(p)]))
    responses: Complexes = four_block.response(frequency)

    def weights(power: float) -> Arrays:
        return np.r_[np.ones(m), np.full(p, math.exp(power))]

    def size(power: float) -> float:
        weight = weights(power)
        return float(np.linalg.norm(responses * weight[:, np.newaxis] / weight, 2, axis=(1, 2)).max())

    typical = math.log(np.linalg.norm(feedback.controller.response(frequency), 2, axis=(1, 2)).mean() + 1e-300)
    found = minimize_scalar(size, bounds=(typical - 8.0, typical + 8.0), method="bounded")
    weight = weights(float(found.x))
    return 1.0 / peak_gain(four_block.scaled(weight, 1.0 / weight)).value, math.exp(float(found.x))
