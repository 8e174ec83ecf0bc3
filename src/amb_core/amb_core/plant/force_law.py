"""The force of one electromagnet along a trajectory, and the identities of its force law.

An electromagnet has N turns on two poles of face area A, an iron path of length l_c and permeability mu_r, and pole
gaps x_g. Its force at a current i is (the paper's eq. 1 to 4, k = mu_0 N^2 A cos(22.5 deg) / 4)

    f  = mu_0 (N i / (l_c / mu_r + 2 x_g))^2 A cos(22.5 deg)                                                 (1)
    f  = k i^2 / x^2,                                   x = x_g + l_c / (2 mu_r)                             (2)
    f' = (2 k i i' x^2 - 2 k i^2 x x') / x^4                                                                 (3)
    f  = k i i' / (x x') - x f' / (2 x')                                                                     (4)

The paper leaves l_c out of (2) and writes x_g; with iron the lengthened gap x must be used there. (4) is (3) divided by
x': it holds for any smooth i and x, and says nothing about their causes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.plant.closed_forms import AXIS_COSINE, force_constant
from amb_core.plant.network import COIL_POLES
from amb_core.plant.parameters import MagneticCircuitParameters
from amb_core.plant.plant import Plant
from amb_core.plant.trace import Trace

Values = NDArray[np.float64]

SLOWEST = 0.05  # of the largest speed: below it (4) divides by almost zero


def iron_path_length(plant: Plant) -> float:
    """Length l_c of an electromagnet's path through iron (m), for the cross-section of a pole face."""
    (pole, pole_area), *rings = plant.network.paths
    face = plant.network.pole_area
    return face * (2.0 * pole / pole_area + sum(length / area for length, area in rings))


def electromagnet_force(circuit: MagneticCircuitParameters, iron_length: float, current: Values, gap: Values) -> Values:
    """Force of an electromagnet by eq. (1) (N), from its current (A) and its pole gap (m)."""
    area = circuit.pole_width * circuit.axial_length
    path = iron_length / circuit.relative_permeability + 2.0 * gap
    return mu_0 * (2 * circuit.turns_per_pole * current / path) ** 2 * area * AXIS_COSINE


@dataclass(frozen=True)
class ForceTrajectory:
    """Current, gap and force of an electromagnet with their rates, in the middle of each of n steps.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time (s).
    current, current_rate : ndarray, shape (n,)
        Coil current i (A) and its rate (A/s).
    gap, gap_rate : ndarray, shape (n,)
        Gap x, lengthened by the iron (m), and its rate (m/s).
    force, force_rate : ndarray, shape (n,)
        Force f (N) and its rate (N/s).
    constant : float
        k of eq. (2) (N m^2/A^2).
    """

    time: Values
    current: Values
    current_rate: Values
    gap: Values
    gap_rate: Values
    force: Values
    force_rate: Values
    constant: float

    @classmethod
    def of(cls, time: Values, current: Values, gap: Values, force: Values, constant: float) -> ForceTrajectory:
        """From samples at equal intervals, shape (n + 1,): means and differences over the intervals."""
        step = time[1] - time[0]

        def middle(values: Values) -> Values:
            return 0.5 * (values[1:] + values[:-1])

        rates = [np.diff(values) / step for values in (current, gap, force)]
        return cls(
            middle(time), middle(current), rates[0], middle(gap), rates[1], middle(force), rates[2], constant
        )  # fmt: skip

    @property
    def rate_by_law(self) -> Values:
        """Rate of the force by eq. (3) (N/s)."""
        k, i, x = self.constant, self.current, self.gap
        return (2.0 * k * i * self.current_rate * x**2 - 2.0 * k * i**2 * x * self.gap_rate) / x**4

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Whether the gap changes fast enough to evaluate eq. (4)."""
        speed = np.abs(self.gap_rate)
        return speed > SLOWEST * speed.max()

    @property
    def force_by_rates(self) -> Values:
        """Force by eq. (4) (N), NaN where the gap hardly changes."""
        k, i, x = self.constant, self.current, self.gap
        speed = np.where(self.moving, self.gap_rate, np.nan)
        return k * i * self.current_rate / (x * speed) - x * self.force_rate / (2.0 * speed)

    @property
    def speed_exponent(self) -> float:
        """Exponent p of the best fit f ~ |x'|^p of force over speed (least squares of logarithms)."""
        speed, force = np.abs(self.gap_rate[self.moving]), self.force[self.moving]
        return float(np.polyfit(np.log(speed), np.log(force), 1)[0])


def trace_gap(trace: Trace, plant: Plant, coil: int) -> Values:
    """Gap of the poles of a coil along a trace (m), the rotor moving along the axis of the coil only."""
    sign, axis = (1.0, -1.0)[coil // 2], coil % 2
    return plant.parameters.magnetic_circuit.air_gap - sign * AXIS_COSINE * trace.position[:, axis]


def trace_force(trace: Trace, plant: Plant, coil: int) -> Values:
    """Force of a coil's poles along its axis (N), from their fluxes."""
    squares = np.sum(trace.flux[:, COIL_POLES[coil]] ** 2, axis=1)
    return squares * AXIS_COSINE / (2.0 * mu_0 * plant.network.pole_area)


def force_trajectory(trace: Trace, plant: Plant, coil: int) -> ForceTrajectory:
    """The trajectory of a coil along a trace; (2) holds on it if circuits are separate and no eddy currents flow."""
    lengthening = iron_path_length(plant) / (2.0 * plant.parameters.magnetic_circuit.relative_permeability)
    return ForceTrajectory.of(
        trace.time,
        trace.current[:, coil],
        trace_gap(trace, plant, coil) + lengthening,
        trace_force(trace, plant, coil),
        force_constant(plant.parameters.magnetic_circuit),
    )
