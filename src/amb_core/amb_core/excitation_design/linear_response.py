"""Response of the linearised loop to an excitation: what the rotor would do if the bearing had no nonlinearity.

The loop is linearised at the point where the controller holds the rotor (`amb_core.plant.linearise`). The control
current that the linear loop requests is not limited: with the static current, which carries the weight, it shows how
often a limit would act.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.closed_forms import inductance
from amb_core.plant.linearise import linearize


@dataclass(frozen=True)
class LinearResponse:
    """Deviations from the operating point.

    Attributes
    ----------
    position : ndarray, shape (steps, 2)
        Positions x, y (m).
    current : ndarray, shape (steps, 2)
        Control currents i_x, i_y, without any limit (A).
    """

    position: NDArray[np.float64]
    current: NDArray[np.float64]


class LinearLoop:
    """The linearised loop of a bearing, bearing A if the rotor has two.

    Parameters
    ----------
    plant : Plant
        The plant; its state is neither used nor changed.
    controller : ControllerParameters
        The controller.

    Attributes
    ----------
    static_current : ndarray, shape (2,)
        Control currents that hold the rotor at rest (A).

    Raises
    ------
    PlantError, ParameterError
        As `linearize`.
    """

    def __init__(self, plant: Plant, controller: ControllerParameters) -> None:
        linearization = linearize(plant, controller)
        loop = linearization.closed_loop
        self._controller = controller
        self._axes = [0, 1] if "x" in plant.axes else [1]
        used = len(self._axes)
        self._a, self._b, self._c = (
            np.ascontiguousarray(matrix) for matrix in (loop.A, loop.B[:, :used], loop.C[:used])
        )
        self.static_current: NDArray[np.float64] = linearization.point.current_reference[:2].copy()

    def respond(self, reference: NDArray[np.float64]) -> LinearResponse:
        """Response to a reference, from rest.

        Parameters
        ----------
        reference : ndarray, shape (steps, 2)
            Deviation of the reference positions x, y (m).
        """
        position = np.zeros(reference.shape)
        driven = np.ascontiguousarray(reference[:, self._axes], dtype=np.float64)
        position[:, self._axes] = _respond(self._a, self._b, self._c, driven)
        return LinearResponse(position, self._law(reference, position))

    def _law(self, reference: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
        """The control law without its limit, zero before the first sample."""
        from scipy.signal import lfilter  # takes a second to import

        current = np.empty_like(position)
        for axis, gains in enumerate(pack_gains(self._controller, position.shape[1])):
            proportional, derivative, keep, weight, on_error, _ = gains
            moved, wanted = position[:, axis], reference[:, axis]
            slope = lfilter([weight, -weight], [1.0, -keep], on_error * wanted - moved)
            current[:, axis] = proportional * (wanted - moved) + derivative * slope
        return current


def effective_current_limit(plant: PlantParameters, controller: ControllerParameters) -> float:
    """Largest control current that the controller allows and all coils can follow (A)."""
    amplifier = plant.amplifier
    limits = [controller.current_limit]
    if amplifier.unipolar:
        limits.append(amplifier.bias_current)
    if amplifier.limits:
        limits.append(amplifier.current_limit - amplifier.bias_current)
    return min(limits)


def slew_rate(plant: PlantParameters) -> float | None:
    """Fastest change of a coil current at the largest mean voltage (A/s); None if the amplifiers have no limits."""
    amplifier = plant.amplifier
    if not amplifier.limits:
        return None
    return amplifier.supply_voltage * (2.0 * amplifier.maximum_duty - 1.0) / inductance(plant.magnetic_circuit)


@numba.njit(cache=True)
def _respond(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], reference: NDArray[np.float64]
) -> NDArray[np.float64]:
    """x[k+1] = A x[k] + B r[k], y[k] = C x[k], from zero."""
    order, inputs = b.shape
    state, advanced = np.zeros(order), np.zeros(order)
    position = np.zeros(reference.shape)
    for step in range(len(reference)):
        for row in range(inputs):
            for column in range(order):
                position[step, row] += c[row, column] * state[column]
        for row in range(order):
            total = 0.0
            for column in range(order):
                total += a[row, column] * state[column]
            for column in range(inputs):
                total += b[row, column] * reference[step, column]
            advanced[row] = total
        state, advanced = advanced, state
    return position
