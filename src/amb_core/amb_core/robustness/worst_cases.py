"""Worst cases over the models that the data of an estimate leave possible, and the bounds that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.linear import Arrays, Complexes
from amb_core.linear.peak import Peak, peak_gain
from amb_core.robustness.ellipsoid import (
    PlantSet,
    Worst,
    closed_loop_objective,
    gap_objective,
    radius_of_all,
    radius_of_one,
)
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.known_band import KnownBand
from amb_core.robustness.mu_upper import balancing
from amb_core.robustness.settings import RobustnessSettings, Zone, zone_of

FAR = 2.0
"""Distance of a model from the best one of its data, in standard deviations, from which the ellipsoid is larger."""
AGREES = 0.1
"""Difference of a bound and the peak of its worst model, relative, up to which the response is linear enough."""
_NEAR = 21  # further frequencies around each peak


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
        Peak of S of the worst model of the ellipsoid, as a model; infinite if its loop is not stable, unless only modes
        above the known band make it so: their place is taken by the assumptions, and the peak is that in the band.
    of_ellipsoid : float
        Largest magnitude of S over the ellipsoid alone, without further errors of the response.
    unstable_above : bool
        Whether only modes above the known band make the loop of that worst model unstable.
    excluded : bool
        Whether that worst model makes an unstable loop, and its response is not among those that the data leave open.
    by_data : bool
        Whether the bounds are those of the error of the response that the data show and leave open, without the
        ellipsoid: its response is not linear in the parameters.
    """

    name: str
    sensitivity: Worst
    complementary: Worst
    disk: Worst
    sensitivity_of_all: Worst
    zone: Zone
    replayed: float
    of_ellipsoid: float
    unstable_above: bool = False
    excluded: bool = False
    by_data: bool = False

    @property
    def linear(self) -> bool:
        """Whether the largest magnitude over the ellipsoid is about the peak of the model that has it."""
        return abs(self.replayed - self.of_ellipsoid) <= AGREES * min(self.of_ellipsoid, self.replayed)

    def at_least(self, sensitivity: Peak, complementary: Peak, disk: Peak, settings: RobustnessSettings) -> AxisBounds:
        """The same, no lower than the exact peaks of the model itself."""
        raised = self.sensitivity.at_least(sensitivity)
        return replace(
            self,
            sensitivity=raised,
            complementary=self.complementary.at_least(complementary),
            disk=self.disk.at_least(disk),
            sensitivity_of_all=self.sensitivity_of_all.at_least(sensitivity),
            zone=zone_of(raised.value, settings.sensitivity_limits),
        )

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
    """Distance of the models of the ellipsoid, and the distance that the loop tolerates.

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


def plants_of(
    feedback: Feedback, uncertainty: ModelUncertainty, frequency: Arrays, known: KnownBand | None, by_data: bool = False
) -> PlantSet:
    """The plants that data leave possible; above the known band those of the assumed class, whatever the model.

    `by_data`: those whose response differs from the model's by no more than the data show and leave open, at every
    frequency, whatever the ellipsoid.
    """
    if known is None:
        return PlantSet.of(uncertainty, frequency)
    plants = PlantSet.of(uncertainty, frequency, known.error(feedback, frequency))
    inside = (frequency <= known.high)[:, np.newaxis, np.newaxis]
    return replace(plants, axes=plants.axes * (inside & (not by_data)))


@dataclass(frozen=True, eq=False)
class WorstCases:
    """Worst cases over the models of an estimate."""

    feedback: Feedback
    uncertainty: ModelUncertainty
    plants: PlantSet
    settings: RobustnessSettings
    known: KnownBand | None = None
    by_data: bool = False

    @classmethod
    def of(
        cls,
        feedback: Feedback,
        uncertainty: ModelUncertainty,
        frequency: Arrays,
        settings: RobustnessSettings,
        known: KnownBand | None,
        by_data: bool = False,
    ) -> WorstCases:
        """Over the plants of some frequencies; see `plants_of`."""
        plants = plants_of(feedback, uncertainty, frequency, known, by_data)
        return cls(feedback, uncertainty, plants, settings, known, by_data)

    @property
    def _wider(self) -> float:
        """Factor of all radii: a model far from the best one of its data is as far from the truth."""
        return self.uncertainty.distance if self.uncertainty.distance > FAR else 1.0

    def axis_by_data(self, axis: int, models: AxisBounds) -> AxisBounds:
        """Bounds by the error of the response that the data leave open; not below the worst model's finite peak."""
        sensitivity, complementary, disk = (
            self._of_axis(axis, plus, 1.0) for plus in (0.0, -1.0, 0.5 * (self.settings.skew - 1.0))
        )
        if math.isfinite(models.replayed):
            sensitivity = replace(sensitivity, value=max(sensitivity.value, models.replayed))
        return replace(
            models,
            sensitivity=sensitivity,
            complementary=complementary,
            disk=disk,
            zone=zone_of(sensitivity.value, self.settings.sensitivity_limits),
            by_data=True,
        )

    def axis(self, axis: int, name: str) -> AxisBounds:
        """Bounds of one axis."""
        confidence, count = self.settings.confidence, self.uncertainty.root.shape[1]
        one = self._wider * radius_of_one(confidence, self.feedback.outputs)
        whole = self._wider * radius_of_all(confidence, count)
        half = 0.5 * (self.settings.skew - 1.0)
        sensitivity, of_all = self._of_axis(axis, 0.0, one), self._of_axis(axis, 0.0, whole)
        of_models = self._of_axis(axis, 0.0, one, alone=True) if self.known is not None else sensitivity
        replayed, above = self._replayed(axis, of_models)
        complementary, disk = self._of_axis(axis, -1.0, one), self._of_axis(axis, half, one)
        if math.isinf(self._replayed(axis, of_all)[0]):
            of_all = replace(of_all, value=math.inf)
        zone = zone_of(sensitivity.value, self.settings.sensitivity_limits)
        excluded = math.isinf(replayed) and self._excluded(of_models)
        bounds = AxisBounds(
            name, sensitivity, complementary, disk, of_all, zone, replayed, of_models.value, above, excluded
        )
        # Beyond a model on the limit of stability the gain means nothing.
        return bounds.unbounded() if math.isinf(replayed) else bounds

    def small_gain(self) -> tuple[float, float]:
        """Largest ||D C S|| of the errors D and the models, and its frequency."""
        m, size = self.feedback.inputs, self.feedback.inputs + self.feedback.outputs
        both = np.eye(size)
        shift, left = np.zeros((m, size - m)), self.plants.without @ both[:m]
        objective = closed_loop_objective(self.feedback, self.plants.frequency, left, both[:, m:], shift)
        action = self.plants.alone.worst(objective, self._wider * radius_of_one(self.settings.confidence)).curve
        gain = action * self.plants.error
        place = int(np.argmax(gain))
        return float(gain[place]), float(self.plants.frequency[place])

    def _replayed(self, axis: int, worst: Worst) -> tuple[float, bool]:
        """Peak of S of an axis with a worst model, and whether only modes above the known band make its loop unstable.

        The peak is infinite where other modes make it unstable, and that of the known band where only those above do.
        """
        moved = self.feedback.with_plant(self.uncertainty.moved(worst.factors))
        part = [self.feedback.inputs + axis]
        of_axis = moved.closed.part(part, part)
        if moved.stable:
            return peak_gain(of_axis).value, False
        if self.known is None or not bool(np.all(moved.unstable_frequencies > self.known.high)):
            return math.inf, False
        inside = self.plants.frequency[self.plants.frequency <= self.known.high]
        return float(np.max(np.abs(of_axis.response(inside)), initial=0.0)), True

    def _excluded(self, worst: Worst) -> bool:
        """Whether the data leave the response of a worst model no longer open; it is not linear in the parameters."""
        if self.known is None or self.known.band is None:
            return False
        inside = (self.plants.frequency >= self.known.low) & (self.plants.frequency <= self.known.high)
        frequency = self.plants.frequency[inside]
        moved = self.feedback.with_plant(self.uncertainty.moved(worst.factors)).plant.response(frequency)
        error = (moved - self.feedback.plant.response(frequency)) @ self.feedback.action(frequency)
        return bool(np.any(np.linalg.norm(error, 2, axis=(1, 2)) > self.known.error(self.feedback, frequency)[0]))

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
        fine = search(plants_of(self.feedback, self.uncertainty, near, self.known, self.by_data))
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
        """Worst nu-gap to the estimate, and what the loop tolerates."""
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
    smallest = minimize_scalar(size, bounds=(typical - 8.0, typical + 8.0), method="bounded")
    weight = weights(float(smallest.x))
    return 1.0 / peak_gain(four_block.scaled(weight, 1.0 / weight)).value, math.exp(float(smallest.x))
