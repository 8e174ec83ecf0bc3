"""A bearing designed to levitate: its plant, gains that hold it, and the proof of both in simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from amb_core.designs.tuning.bearing import Bearing, plant_of
from amb_core.designs.tuning.gains import HIGHEST_PEAK, Tuned, candidates, centred, result_of, tune
from amb_core.designs.tuning.levitation import LiftOff, lift_off
from amb_core.designs.tuning.loop_family import LoopFamily
from amb_core.designs.tuning.reasons import reason, require_lift_off
from amb_core.designs.tuning.sizing import Sizing, require_flux
from amb_core.ground.errors import AmbError, PlantError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, linearize

TRIED = 8
"""Gains of the wide grid that are simulated if the first do not lift the rotor off."""
BETTER = 10.0
"""Factor by which a part is made better to see whether it is the reason why a rotor stays down."""

SAME_FREQUENCY = 0.01
"""Relative difference of the switching frequency from the given one that is worth no remark."""


@dataclass(frozen=True)
class BearingDesign:
    """A bearing that levitates.

    Attributes
    ----------
    bearing : Bearing
        The numbers it was made of.
    plant : PlantParameters
        Its plant.
    tuned : Tuned
        Its gains, and their loop.
    lift_off : LiftOff
        How the rotor rose in the nonlinear simulation.
    lift_off_current : float
        Control current that just lifts the rotor off the backup bearing (A).
    sizing : Sizing
        What it can do by closed forms.
    """

    bearing: Bearing
    plant: PlantParameters
    tuned: Tuned
    lift_off: LiftOff
    lift_off_current: float
    sizing: Sizing

    @property
    def remarks(self) -> list[str]:
        """What is little or much, and what is used instead of a given number."""
        given, used = self.bearing.switching_frequency, self.plant.amplifier.switching_frequency
        if abs(used - given) <= SAME_FREQUENCY * given:
            return self.sizing.remarks
        other = f"the switching frequency is {used:.6g} Hz instead of {given:.6g} Hz: whole periods in a sample"
        return [*self.sizing.remarks, other]


def design_bearing(bearing: Bearing, highest_peak: float = HIGHEST_PEAK) -> BearingDesign:
    """The plant of a bearing, with PD gains that lift its rotor off and hold it with a low peak sensitivity.

    Parameters
    ----------
    bearing : Bearing
        The bearing.
    highest_peak : float, optional
        Largest peak sensitivity (-).

    Returns
    -------
    BearingDesign
        Plant, gains, and how the rotor lifts off.

    Raises
    ------
    PlantError
        If no PD gains do, with the part of the bearing that is the reason.
    """
    parameters = plant_of(bearing)
    sizing = require_flux(parameters)
    controller = _controller(bearing)
    lifting = require_lift_off(parameters, controller)
    tuned = tune(parameters, controller, highest_peak)
    if tuned is None:
        raise PlantError(f"no PD gains stabilise this bearing: {reason(parameters, controller, highest_peak)}")
    if tuned.peak_sensitivity > highest_peak:
        raise PlantError(
            f"no PD gains of this bearing have a peak sensitivity of at most {highest_peak:g}; the lowest is "
            f"{tuned.peak_sensitivity:.3g}: {reason(parameters, controller, highest_peak)}"
        )
    lifted = _lifted(parameters, tuned, highest_peak)
    if lifted is None:
        raise PlantError(_why_it_stays_down(bearing, highest_peak))
    trial, risen = lifted
    return BearingDesign(bearing, parameters, trial, risen, lifting, sizing)


def _controller(bearing: Bearing) -> ControllerParameters:
    values = {"sample_rate": bearing.sample_rate, "current_limit": bearing.control_current_limit}
    return validate(ControllerParameters, values)


def _lifted(parameters: PlantParameters, tuned: Tuned, highest_peak: float) -> tuple[Tuned, LiftOff] | None:
    """The first gains that lift the rotor off in simulation."""
    for trial in chain([tuned], _others(parameters, tuned, highest_peak)):
        risen = lift_off(parameters, trial.controller)
        if risen is not None and risen.levitated:
            return trial, risen
    return None


def _others(parameters: PlantParameters, tuned: Tuned, highest_peak: float) -> Iterator[Tuned]:
    """Other gains with low peaks, evenly chosen from the least to the most derivative action."""
    plant = Plant(parameters)
    family = LoopFamily(linearize(plant, centred(parameters, tuned.controller), np.zeros(2)))
    pairs = candidates(plant, family, highest_peak)
    chosen = sorted({round(place) for place in np.linspace(0, len(pairs) - 1, TRIED)}) if pairs else []
    for place in chosen:
        try:
            trial = result_of(plant, family, pairs[place])
        except PlantError:  # with these gains the rotor would rest somewhere else
            continue
        if trial.peak_sensitivity <= highest_peak:
            yield trial


def _why_it_stays_down(bearing: Bearing, highest_peak: float) -> str:
    """The parts of the bearing of which each lifts the rotor off when it alone is better."""
    parts = [text for text, changes in _better(bearing) if _lifts(bearing.model_copy(update=changes), highest_peak)]
    reason = " or ".join(parts) or (
        f"no part alone is the reason; tried: {BETTER:g} times the voltage, the control current and the sample rate"
    )
    return f"small motions in the loop are stable, but the rotor does not rise from the backup bearing: {reason}"


def _better(bearing: Bearing) -> list[tuple[str, dict[str, float]]]:
    """Parts of a bearing in words, and what makes each better."""
    limit, rate = bearing.control_current_limit, bearing.sample_rate
    return [
        (
            f"amplifier too slow: {bearing.voltage:g} V do not change the coil currents fast enough",
            {"voltage": min(BETTER * bearing.voltage, 5000.0)},
        ),
        (
            f"the control current is limited to {limit:.3g} A",
            {"current_limit": min(bearing.bias_current + BETTER * limit, 100.0)},
        ),
        (
            f"sampling too slow ({rate:g} Hz, delay of {bearing.delay:g} samples)",
            {
                "sample_rate": min(BETTER * rate, 1e5),
                "switching_frequency": max(bearing.switching_frequency, min(BETTER * rate, 1e5)),
                "delay": 0.0,
            },
        ),
    ]


def _lifts(bearing: Bearing, highest_peak: float) -> bool:
    try:
        parameters = plant_of(bearing)
        tuned = tune(parameters, _controller(bearing), highest_peak)
    except AmbError:
        return False
    return tuned is not None and _lifted(parameters, tuned, highest_peak) is not None
