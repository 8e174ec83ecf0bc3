"""Trial of an excitation: simulation of the full plant, the region in which it runs, and its deviation from linearity.

The classifier (`amb_core.regions`) detects B by a drifting bias, as in a sweep. A signal with a constant spectrum over
time moves the bias at its beginning and keeps it there: the same nonlinearity, but without drift. So the shift of the
bias from rest is measured too, less the loop's linear response to a reference with a mean value. A shift by the
classifier's `drift_threshold` or more counts as B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.excitation.linear_response import (
    LinearLoop,
    LinearResponse,
    effective_current_limit,
    slew_rate,
)
from amb_core.designs.excitation.measures import AxisMeasure, measure_trial
from amb_core.designs.excitation.spans import spans_on_one_bearing
from amb_core.excitation import ExcitationSignal
from amb_core.ground.errors import ExcitationError
from amb_core.ground.progress import Progress
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import require_loop, simulate_first_bearing
from amb_core.regions import Onset, Region, RegionParameters, classify


@dataclass(frozen=True)
class Trial:
    """Result of an excitation in simulation.

    Attributes
    ----------
    region : Region
        Highest region that the rotor entered.
    classified : Region
        The same by the classifier alone, without the shift of the bias.
    onsets : dict of Region to Onset
        From the classifier; steps count from the release of the rotor, `rest` before the excitation.
    bias_shift : ndarray, shape (2,)
        Shift of the bias of x and y from rest, the largest one if axes are excited in turn (m); NaN if the rotor
        delevitated before it could be measured.
    record : LoopRecord
        Samples of the run.
    measures : tuple of AxisMeasure
        Of the excited axes; none if the rotor delevitated.
    """

    region: Region
    classified: Region
    onsets: dict[Region, Onset]
    bias_shift: NDArray[np.float64]
    record: LoopRecord
    measures: tuple[AxisMeasure, ...] = ()


class TrialBench:
    """A simulated bearing for trials of excitations.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    regions : RegionParameters, optional
        Thresholds of the classifier; by default those of `RegionParameters`, with the plant's backup bearing.
    rest : float, optional
        Time before the excitation in which the rotor settles (s).

    Attributes
    ----------
    linear : LinearLoop
        The linearised loop.
    current_limit : float
        Limit of the control current (A).

    Raises
    ------
    PlantError
        If the plant cannot be built, or the controller cannot hold the rotor.
    """

    def __init__(
        self,
        plant: PlantParameters,
        controller: ControllerParameters,
        regions: RegionParameters | None = None,
        rest: float = 1.0,
    ) -> None:
        require_loop(plant, controller)
        self.regions = regions or RegionParameters(backup_bearing_radius=plant.rotor.backup_bearing_radius)
        self._plant = Plant(plant)
        self._one_axis = plant.magnetic_circuit.actuators != "two_axis"
        self._controller = controller
        self._rest = rest
        self.linear = LinearLoop(self._plant, controller)
        self.current_limit = effective_current_limit(plant, controller)
        self._slew_rate = slew_rate(plant, self.linear.static_current)

    def run(self, signal: ExcitationSignal, progress: Progress | None = None) -> Trial:
        """Simulate a signal from rest to its end, or until the rotor delevitates.

        Parameters
        ----------
        signal : ExcitationSignal
            The excitation.
        progress : callable, optional
            See `amb_core.ground.progress.Progress`. None for no calls.

        Returns
        -------
        Trial
            Measures of the excited axes, regions and samples.

        Raises
        ------
        ExcitationError
            If the signal is made for another sample rate or more than one bearing, or excites x on a bearing that pulls
            along y only, or the rotor delevitates before the excitation.
        """
        if abs(signal.sample_time * self._controller.sample_rate - 1.0) > 1e-9:
            raise ExcitationError(
                f"the signal is sampled at {1.0 / signal.sample_time:g} Hz, the loop at "
                f"{self._controller.sample_rate:g} Hz; generate it at the rate of the loop"
            )
        spans = spans_on_one_bearing(signal)
        if self._one_axis and signal.samples[:, 0].any():
            raise ExcitationError(
                f"axes = '{signal.parameters.axes}' is not allowed: the magnets of this bearing pull along y only"
            )
        rest = round(self._rest / signal.sample_time)
        steps = rest + signal.steps
        record = simulate_first_bearing(
            self._plant,
            self._controller,
            steps,
            signal.samples,
            rest,
            progress,
        )
        if self._plant.delevitated and record.steps <= rest:
            raise ExcitationError(
                f"the rotor delevitates {record.steps * signal.sample_time:.2g} s after its release, before any "
                "excitation: the controller does not hold it, so no amplitude is small enough; change the controller"
            )
        classification = classify(record, self.regions, delevitated=self._plant.delevitated)
        classified = max(classification.onsets, default=Region.A)
        linear = self.linear.respond(signal.samples)
        shift = self._bias_shift(record, signal, rest, linear)
        moved = bool(np.any(np.abs(shift) >= self.regions.drift_threshold))
        region = max(classified, Region.B if moved else Region.A)
        measures: tuple[AxisMeasure, ...] = ()
        if record.steps == steps:
            axes = [axis for axis, _, _ in spans]
            measures = measure_trial(record, rest, axes, linear, self.current_limit, self._slew_rate)
        return Trial(region, classified, classification.onsets, shift, record, measures)

    def _bias_shift(
        self, record: LoopRecord, signal: ExcitationSignal, rest: int, linear: LinearResponse
    ) -> NDArray[np.float64]:
        """Mean position under excitation, less that at rest and less the mean of the linear response."""
        settling = round(self.regions.settling_time / signal.sample_time)
        before = slice(max(rest - settling, 0), rest)
        shifts = [np.full(2, np.nan)]
        for first, last in {(first, last) for _, first, last in spans_on_one_bearing(signal)}:
            span = slice(rest + (first + settling if last - first > 2 * settling else first), rest + last)
            if record.steps >= span.stop:
                moved = record.position[span].mean(axis=0) - record.position[before].mean(axis=0)
                shifts.append(moved - linear.position[span.start - rest : span.stop - rest].mean(axis=0))
        largest = np.nanargmax(np.abs(np.array(shifts[1:])), axis=0) if len(shifts) > 1 else None
        return shifts[0] if largest is None else np.array(shifts[1:])[largest, [0, 1]]
