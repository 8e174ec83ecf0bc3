"""Gains of the PD controller for a machine: on a grid, the smallest derivative gain with a low peak sensitivity.

The derivative gain decides how much current noise and fast motion take, and so when the amplifiers reach their limits.

The plant is linearised once, with its rotor held at the centre. K_P is searched as the ratio of the stiffness k_i K_P
to the negative stiffness k_s, K_D as the damping ratio zeta that a rigid rotor of the mass at a bearing would have,

    K_P = ratio k_s / k_i,    K_D = 2 zeta sqrt((k_i K_P - k_s) m) / k_i.

Bending modes, amplifiers and sampling are in the linear model, so a loop that they make unstable is not chosen.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 2 and 8 (stiffness and damping by PD
control); ISO 14839-3 (peak sensitivity as a measure of the stability margin).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import PlantError
from amb_core.linear.peak import h_infinity_norm
from amb_core.loop.control import ControllerParameters
from amb_core.parameters import flatten, part_of, validate
from amb_core.plant.averaged import AveragedPlant
from amb_core.plant.closed_forms import current_gain, negative_stiffness
from amb_core.plant.linearise import close_loop, linearize
from amb_core.plant.plant import Plant
from amb_core.plant.rotor import rotor_mass

STIFF, SOFT = (3.0, 4.0, 5.0, 6.0), (1.6, 2.0, 2.5)
"""Ratios of the stiffnesses; the soft ones only if no stiff loop has a peak sensitivity that is low enough."""
ZETAS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0, 1.4, 2.0)
ENOUGH = 1.5
"""Peak sensitivity (-) that is low enough; if no gains of the grid reach it, those with the lowest are chosen."""


@dataclass(frozen=True)
class ChosenGains:
    """A controller, with the largest singular value of its sensitivity and the currents that carry the weight (A)."""

    controller: ControllerParameters
    peak_sensitivity: float
    current: NDArray[np.float64]


def choose_gains(plant: Plant, controller: ControllerParameters | None = None) -> ChosenGains:
    """Gains, the same on all axes, and the nominal reference that holds the rotor at the centre of its bearings.

    Parameters
    ----------
    plant : Plant
        Gives the parameters; its state is neither used nor changed.
    controller : ControllerParameters, optional
        Gives everything but gains and nominal reference.

    Raises
    ------
    PlantError
        If the currents cannot carry the rotor, or no gains of the grid make a stable loop.
    """
    given = controller or ControllerParameters(sample_rate=1.0 / plant.sample_time)
    given = part_of(ControllerParameters, given.model_dump())  # without the other parameters of a node
    given = _changed(given, {"proportional_gains": (), "derivative_gains": ()})
    model = linearize(plant, given, np.zeros(2))
    current = model.point.current_reference
    largest = float(np.abs(current).max())
    if largest >= given.current_limit:
        raise PlantError(
            f"carrying the rotor needs a control current of {largest:.3g} A; allowed: less than the controller's "
            f"current_limit, {given.current_limit:g} A; larger magnets or a larger bias current carry more"
        )
    found: list[tuple[float, ControllerParameters]] = []
    for ratios in (STIFF, SOFT):
        trials = [_changed(given, _gains(plant, ratio, zeta)) for ratio, zeta in product(ratios, ZETAS)]
        peaks = [(h_infinity_norm(close_loop(model.discrete, trial)[1]), trial) for trial in trials]
        found += [(peak, trial) for peak, trial in peaks if np.isfinite(peak)]
        if any(peak <= ENOUGH for peak, _ in found):
            break
    if not found:
        raise PlantError(
            "no PD gains of the grid make a stable loop with this rotor; its bending modes need another controller, or "
            "sensors and bearings at other places"
        )
    enough = max(ENOUGH, min(peak for peak, _ in found))
    peak, chosen = min((one for one in found if one[0] <= enough), key=lambda one: one[1].derivative_gain)
    measured = AveragedPlant(plant).sensors() @ model.point.state  # not zero where a sensor is beside its bearing
    nominal = np.round(measured + current / chosen.proportional_gain, 9) + 0.0  # without -0
    return ChosenGains(_changed(chosen, {"nominal_reference": nominal.tolist()}), peak, current)


def _gains(plant: Plant, ratio: float, zeta: float) -> dict[str, float]:
    """K_P and K_D, rounded to three digits."""
    circuit, bias = plant.parameters.magnetic_circuit, plant.parameters.amplifier.bias_current
    gain, stiffness = current_gain(circuit, bias), negative_stiffness(circuit, bias)
    mass = rotor_mass(plant.parameters, plant.rotor) / plant.bearings
    return {
        "proportional_gain": float(f"{ratio * stiffness / gain:.3g}"),
        "derivative_gain": float(f"{2.0 * zeta * np.sqrt((ratio - 1.0) * stiffness * mass) / gain:.3g}"),
    }


def _changed(controller: ControllerParameters, values: dict[str, Any]) -> ControllerParameters:
    return validate(ControllerParameters, {**flatten(controller.model_dump()), **values})
