"""How much of a processor core an emulated plant needs, and what to switch off if that is too much."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from amb_core.ground.errors import AmbError, PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters

ENOUGH = 0.9
"""Share of a core beyond which a loop does not keep its pace; target, network and system need the rest."""
_WARM, _STEPS, _PARTS = 20, 100, 3  # the fastest of three parts counts: other work on the machine slows down
_GAIN = 0.95  # a change that leaves more of the time than this is not worth an effect
_LONGER_STEP = 1e-6  # s


@dataclass(frozen=True)
class Load:
    """What a measurement at the start has found.

    Attributes
    ----------
    share : float
        Processor time of a control step over the wall-clock time in which it is due (-).
    remedy : tuple of (str, float)
        Parameters with other values, and the share (-) with each of them and those before it; empty if there is no
        need.
    still : tuple of str
        Axes whose sensors show the same position bit for bit in every step.
    """

    share: float
    remedy: tuple[tuple[str, float], ...] = ()
    still: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.share <= ENOUGH:
            return f"a control step takes {100 * self.share:.0f} % of the time that it has on one core"
        changes = "; ".join(f"{name} ({100 * share:.0f} %)" for name, share in self.remedy)
        return (
            f"too slow for this pace: a control step takes {100 * self.share:.0f} % of the time that it has on one "
            f"core, allowed: up to {100 * ENOUGH:.0f} %. It continues, and counts the deadlines that it misses. "
            f"Simulator parameters that would help, each with those before it: {changes or 'none found'}; or a "
            "smaller real_time_factor"
        )


def measure_load(plant: PlantParameters, controller: ControllerParameters, factor: float) -> Load:
    """Measure some hundred levitated steps, and, if they take too long, search what to switch off.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        What is emulated.
    factor : float
        Simulation time over wall-clock time (-); 0 for no pace.

    Returns
    -------
    Load
        The measured share, and what would lower it.
    """
    period = 1.0 / (plant.integration.sample_rate * factor) if factor > 0.0 else np.inf
    time_taken, still = _measure(plant, controller)
    share = time_taken / period
    return Load(share, tuple(_remedy(plant, controller, share, period)), still)


def _remedy(
    plant: PlantParameters, controller: ControllerParameters, share: float, period: float
) -> Iterator[tuple[str, float]]:
    values = flatten(plant.model_dump())
    for change in _changes(plant):
        if share <= ENOUGH:
            return
        try:
            changed = validate(PlantParameters, values | change)
            then = _measure(changed, controller)[0] / period
        except AmbError:  # not possible in this machine
            continue
        if then < _GAIN * share:
            yield ", ".join(f"{name}: {_shown(value)}" for name, value in change.items()), then
            values, share = values | change, then


def _changes(plant: PlantParameters) -> Iterator[dict[str, Any]]:
    """What makes a plant faster, that which changes its behaviour least first."""
    if plant.integration.internal_step < _LONGER_STEP:
        yield {"integration.internal_step": _LONGER_STEP}
    if plant.iron.laminations != "thin":
        yield {"iron.laminations": "thin"}
    if plant.iron.hysteresis:
        yield {"iron.hysteresis": False}
    if plant.iron.solid_journal:
        yield {"iron.solid_journal": False}
    if plant.iron.saturation:
        yield {"iron.hysteresis": False, "iron.saturation": False}
    if plant.rotor.axial and plant.thrust_bearing.eddy_currents:
        yield {"thrust_bearing.eddy_currents": False}
    if plant.amplifier.switching:
        yield {"amplifier.switching": False}


def _shown(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _measure(parameters: PlantParameters, controller: ControllerParameters) -> tuple[float, tuple[str, ...]]:
    """Processor time of a levitated step (s), and the axes that stand still; compiles what is not yet compiled."""
    plant = Plant(parameters)
    names = plant.machine.axis_names
    law = PdController(controller.at_rate(parameters.integration.sample_rate), len(names))
    _levitate(plant, law, _WARM)
    times, positions = [], []
    for _ in range(_PARTS):
        began = time.thread_time()
        positions += _levitate(plant, law, _STEPS)
        times.append(time.thread_time() - began)
    still = tuple(name for name, span in zip(names, np.ptp(positions, axis=0), strict=True) if span == 0.0)
    return min(times) / _STEPS, still


def _levitate(plant: Plant, law: PdController, steps: int) -> list[tuple[float, ...]]:
    """Positions over a number of steps; a rotor that falls starts anew."""
    positions = []
    for _ in range(steps):
        positions.append(plant.position)
        try:
            plant.advance(law.update(plant.position, law.nominal_reference))
        except PlantError:
            plant.reset()
        if plant.delevitated:
            plant.reset()
    return positions
