"""Response of the linearised loop to an excitation: what the rotor would do if the bearing had no nonlinearity.

The loop is linearised at the point where the controller holds the rotor (`amb_core.plant.linearise`). The control
current that the linear loop requests is not limited: with the static current, which carries the weight, it shows how
often a limit would act.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ExcitationError
from amb_core.linear.simulation import simulate
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.closed_forms import inductance
from amb_core.plant.linearise import linearize
from amb_core.plant.voltage import largest_mean_voltage, slew_voltage


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
    ExcitationError
        If the loop is unstable.
    """

    def __init__(self, plant: Plant, controller: ControllerParameters) -> None:
        linearization = linearize(plant, controller)
        if not linearization.stable:
            raise ExcitationError(
                f"the loop is unstable without any excitation: its largest pole is "
                f"{linearization.closed_loop.radius:.6f} in the z plane; no amplitude is small enough, so change the "
                "controller (`amb tune gains` suggests gains)"
            )
        self._controller = controller
        self._axes = [0, 1] if "x" in plant.axes else [1]
        used = len(self._axes)
        self._loop = linearization.closed_loop.part(slice(used), slice(used))
        self.static_current: NDArray[np.float64] = linearization.point.current_reference[:2].copy()

    def respond(self, reference: NDArray[np.float64]) -> LinearResponse:
        """Response to a reference, from rest.

        Parameters
        ----------
        reference : ndarray, shape (steps, 2)
            Deviation of the reference positions x, y (m).
        """
        position = np.zeros(reference.shape)
        position[:, self._axes] = simulate(self._loop, np.asarray(reference[:, self._axes], dtype=np.float64))
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
        resistance = plant.magnetic_circuit.coil_resistance
        if resistance > 0.0:
            limits.append(max(largest_mean_voltage(plant) / resistance - amplifier.bias_current, 0.0))
    return min(limits)


def slew_rate(plant: PlantParameters, static_current: NDArray[np.float64]) -> float | None:
    """Fastest change of a coil current at rest by the largest mean voltage (A/s); None for ideal amplifiers.

    The voltage drives the current through the resistance of the coil too, see `amb_core.plant.voltage`.

    Parameters
    ----------
    plant : PlantParameters
        The plant.
    static_current : ndarray, shape (2,)
        Control currents that hold the rotor at rest (A).
    """
    if not plant.amplifier.limits:
        return None
    return slew_voltage(plant, static_current) / inductance(plant.magnetic_circuit)
