"""Mean voltage of the amplifiers over a switching period: the largest, and what is left of it to change a current."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.parameters import PlantParameters


def largest_mean_voltage(plant: PlantParameters) -> float:
    """Mean coil voltage at the largest duty cycle (V)."""
    return plant.amplifier.supply_voltage * (2.0 * plant.amplifier.maximum_duty - 1.0)


def slew_voltage(plant: PlantParameters, static_current: NDArray[np.float64]) -> float:
    """Largest mean voltage less what drives the coil current at rest through the resistance of the coil (V).

    At rest the highest coil current is the bias current and the larger of the static currents.

    Parameters
    ----------
    plant : PlantParameters
        The plant.
    static_current : ndarray, shape (2,)
        Control currents that hold the rotor at rest (A).
    """
    highest = plant.amplifier.bias_current + float(np.max(np.abs(static_current)))
    return max(largest_mean_voltage(plant) - plant.magnetic_circuit.coil_resistance * highest, 0.0)
