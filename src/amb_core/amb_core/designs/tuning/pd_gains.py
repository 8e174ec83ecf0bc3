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

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.tuning.loop_family import WITHOUT_LISTS, LoopFamily
from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import declarations, part_of
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant import Plant, linearize
from amb_core.plant.averaged import AveragedPlant
from amb_core.plant.closed_forms import current_gain, negative_stiffness
from amb_core.plant.linearise import Linearization
from amb_core.plant.rotor import rotor_mass

STIFF, SOFT = (3.0, 4.0, 5.0, 6.0), (1.6, 2.0, 2.5)
"""Ratios of the stiffnesses; the soft ones only if no stiff loop has a peak sensitivity that is low enough."""
ZETAS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0, 1.4, 2.0)
LARGEST_REFERENCE = next(
    item.maximum or np.inf for item in declarations(ControllerParameters) if item.name == "nominal_reference"
)
"""Largest magnitude of a nominal reference that a controller takes (m)."""
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
    model = linearize(plant, given.model_copy(update=WITHOUT_LISTS), np.zeros(2))
    require_carrying(model, given)
    family = LoopFamily(model, every_axis=True)
    peaks: dict[tuple[float, float], float] = {}
    for ratios in (STIFF, SOFT):
        pairs = [placed_gains(plant, ratio, zeta) for ratio, zeta in product(ratios, ZETAS)]
        peaks |= {pair: peak for pair in pairs if np.isfinite(peak := family.peak(*pair))}
        if min(peaks.values(), default=np.inf) <= ENOUGH:
            break
    if not peaks:
        raise PlantError(
            "no PD gains of the grid make a stable loop with this rotor; its bending modes need another controller, or "
            "sensors and bearings at other places"
        )
    enough = max(ENOUGH, min(peaks.values()))
    chosen = min((pair for pair, peak in peaks.items() if peak <= enough), key=lambda pair: pair[1])
    held = held_at_centre(plant, model, family.controller(*chosen))
    return ChosenGains(held, family.exact_peak(*chosen), model.point.current_reference)


def placed_gains(plant: Plant, ratio: float, zeta: float) -> tuple[float, float]:
    """K_P (A/m) and K_D (A s/m) for k_i K_P over k_s, and the damping ratio of a rigid rotor; of three digits."""
    circuit, bias = plant.parameters.magnetic_circuit, plant.parameters.amplifier.bias_current
    k_i, k_s = current_gain(circuit, bias), negative_stiffness(circuit, bias)
    mass = rotor_mass(plant.parameters, plant.rotor) / plant.bearings
    return three_digits(ratio * k_s / k_i), three_digits(2.0 * zeta * np.sqrt((ratio - 1.0) * k_s * mass) / k_i)


def three_digits(value: float) -> float:
    """Rounded to three significant digits, as gains are written."""
    return float(f"{value:.3g}")


def require_carrying(model: Linearization, controller: ControllerParameters) -> None:
    """Raise PlantError if carrying the rotor in the centre takes more than the largest control current."""
    needed = float(np.abs(model.point.current_reference).max())
    if needed >= controller.current_limit:
        raise PlantError(
            f"static load beyond the force: carrying the rotor in the centre needs a control current of {needed:.3g} "
            f"A; allowed: less than {controller.current_limit:g} A; more turns, a larger bias current or larger "
            "magnets carry more"
        )


def held_at_centre(plant: Plant, model: Linearization, controller: ControllerParameters) -> ControllerParameters:
    """With the nominal references at which the controller holds the rotor in the centre of its bearings.

    Raises
    ------
    PlantError
        If one is beyond what a controller takes.
    """
    axes = len(plant.machine.axes)
    radial = len(model.point.current_reference)
    measured = AveragedPlant(plant).sensors() @ model.point.state  # not zero where a sensor is beside its bearing
    references = controller.references(axes).copy()
    gains = pack_gains(controller, axes)[:radial, 0]
    references[:radial] = measured + model.point.current_reference / gains
    farthest = int(np.argmax(np.abs(references[:radial])))
    if abs(references[farthest]) > LARGEST_REFERENCE:
        raise PlantError(
            f"carrying the rotor in the centre takes a nominal reference of {1e3 * abs(references[farthest]):.3g} mm "
            f"with K_P = {gains[farthest]:g} A/m; allowed: {1e3 * LARGEST_REFERENCE:g} mm; a larger K_P, a larger bias "
            "current or more turns need less"
        )
    return controller.model_copy(update={"nominal_reference": tuple((np.round(references, 9) + 0.0).tolist())})
