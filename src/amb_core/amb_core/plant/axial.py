"""The rotor along its axis: a thrust bearing with its amplifiers, and the rotor's mass, apart from all radial motion.

The equation of motion is m z'' = f_1 - f_2 + f_external, with the pull f_1 of the magnet at the side of +z. Axial and
radial motion do not act on each other: a displacement of the disc in its own plane does not change its gaps, and the
tilt of a rotor in its backup bearings changes them by little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.kernel import axial as kernel
from amb_core.plant.packing import pack_amplifier, pack_terms, records_of, sensor_share
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.sensing import Sensing
from amb_core.plant.thrust_bearing import (
    ThrustCircuit,
    half_order_terms,
    holding_duty,
    thrust_amplifier,
    thrust_circuit,
)


@dataclass(frozen=True)
class AxialSnapshot:
    """State of the thrust bearing at the end of a sample; magnets are those that pull along +z and -z.

    Attributes
    ----------
    coil_current : ndarray, shape (2,)
        Coil currents (A), means over the last internal step.
    flux_density : ndarray, shape (2, 2)
        In the air gaps at the inner and outer pole (columns) of each magnet (T).
    force : float
        Magnetic force on the disc along z (N).
    contact_force : float
        Force of the axial backup bearing on the rotor (N).
    position : float
        Of the disc (m).
    contact : bool
        Whether the backup bearing pushed the rotor or the rotor has reached it.
    """

    coil_current: NDArray[np.float64]
    flux_density: NDArray[np.float64]
    force: float
    contact_force: float
    position: float
    contact: bool


@dataclass(frozen=True)
class AxialTrace:
    """Variables of the thrust bearing at the start of every internal step; magnets pull along +z and -z.

    Attributes
    ----------
    flux, flux_rate : ndarray, shape (n, 2)
        Fluxes (Wb) and their rates over the step (Wb/s).
    current, voltage : ndarray, shape (n, 2)
        Coil currents (A) and coil voltages (V), means over the step.
    force : ndarray, shape (n, 2)
        Pull of each magnet (N); the force along z is their difference.
    position, velocity, contact_force : ndarray, shape (n,)
        Of the rotor (m, m/s), and force of the backup bearing on it (N).
    """

    flux: NDArray[np.float64]
    flux_rate: NDArray[np.float64]
    current: NDArray[np.float64]
    voltage: NDArray[np.float64]
    force: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    contact_force: NDArray[np.float64]


class Axial:
    """Thrust bearing and axial position of a plant.

    Parameters
    ----------
    parameters : PlantParameters
        The plant; `rotor.axial` itself is not used.
    mass : float
        Mass of the rotor (kg).

    Attributes
    ----------
    circuit : ThrustCircuit
        Magnetic circuit of each magnet.
    mass : float
        Mass of the rotor (kg).

    Raises
    ------
    PlantError
        If the eddy currents are not fitted.
    """

    def __init__(self, parameters: PlantParameters, mass: float) -> None:
        self.parameters, self.mass = parameters, mass
        self.circuit = thrust_circuit(parameters.thrust_bearing)
        self._constants = _pack(parameters, mass, self.circuit)
        self._state = records_of(kernel.AXIAL_STATE)
        self._sensing = Sensing(parameters, 1, stream=1)
        self.reset()

    def reset(self) -> None:
        """Rotor at rest at its initial position, amplifiers and fluxes at rest with the bias currents."""
        bearing, start = self.parameters.thrust_bearing, self.parameters.rotor.initial_z
        self._state[:] = np.zeros((), kernel.AXIAL_STATE)
        amplifier = thrust_amplifier(self.parameters)
        period = self._constants[0]["amplifier"]["period"]
        state = self._state[0]
        state["position"] = state["sensed"] = start
        state["current"] = bearing.bias_current
        state["current_sum"] = bearing.bias_current * period
        state["flux"] = self.circuit.turns * bearing.bias_current / self.circuit.reluctances(start)
        state["integral"] = holding_duty(self.parameters, bearing.bias_current) if amplifier.integral_gain else 0.0
        state["duty"] = 0.5
        self._sensing.reset()
        self.measure()

    def advance(self, reference: float, steps: int, trace: NDArray[np.float64]) -> int:
        """Hold a control current reference (A) over internal steps; the status of `kernel.advance_axial`."""
        return int(kernel.advance_axial(self._constants, self._state, reference, steps, trace))

    def measure(self) -> None:
        """Take the measurement of the next sample."""
        sensed = self._state["sensed"]
        self._measured = float((self._sensing.measure(sensed) if self._sensing.real else sensed)[0])

    @property
    def measured(self) -> float:
        """Measured position at the end of the last sample (m)."""
        return self._measured

    @property
    def coil_currents(self) -> NDArray[np.float64]:
        """Of the two magnets at the end of the last internal step (A), shape (2,)."""
        return np.array(self._state[0]["current"])

    @property
    def contact(self) -> bool:
        """Whether the backup bearing pushed the rotor in the last internal step."""
        return bool(self._state["contact_force"].any())

    def snapshot(self) -> AxialSnapshot:
        """Currents, flux densities and force at the end of the last internal step."""
        state = self._state[0]
        position, contact_force = float(state["position"]), float(state["contact_force"])
        flux = state["flux"].copy()
        return AxialSnapshot(
            coil_current=state["current"].copy(),
            flux_density=flux[:, np.newaxis] / np.array(self.circuit.pole_areas),
            force=float(self.circuit.pull * (flux[0] ** 2 - flux[1] ** 2)),
            contact_force=contact_force,
            position=position,
            contact=contact_force != 0.0 or abs(position) >= self.parameters.thrust_bearing.clearance,
        )


def unpack_axial(rows: NDArray[np.float64]) -> AxialTrace:
    """Name the columns of a trace, shape (n, ROW_SIZE), that the kernel wrote."""
    parts = np.split(rows, np.cumsum(list(kernel.FIELDS.values()))[:-1], axis=1)
    columns = zip(kernel.FIELDS, parts, strict=True)
    return AxialTrace(**{name: part if kernel.FIELDS[name] > 1 else part[:, 0] for name, part in columns})


def _pack(parameters: PlantParameters, mass: float, circuit: ThrustCircuit) -> NDArray[Any]:
    """Record of the constants of the kernel."""
    bearing, contact, rotor = parameters.thrust_bearing, parameters.backup_bearing, parameters.rotor
    step = parameters.integration.internal_step
    constants = records_of(kernel.AXIAL_CONSTANTS)
    record = constants[0]
    record["step"] = step
    record["mass"] = mass
    record["gap"] = circuit.air_gap
    record["gap_reluctance"] = circuit.gap_reluctance
    record["iron_reluctance"] = circuit.iron_reluctance
    record["pull"] = circuit.pull
    record["turns"] = circuit.turns
    record["resistance"] = bearing.coil_resistance
    record["lag_reluctance"] = circuit.centred_reluctance
    pack_terms(record, half_order_terms(circuit.lag), step)
    pack_amplifier(record["amplifier"], parameters.model_copy(update={"amplifier": thrust_amplifier(parameters)}))
    record["external_force"] = rotor.external_force_z
    record["external_frequency"] = 2.0 * np.pi * rotor.external_force_frequency
    record["clearance"] = bearing.clearance
    record["contact"] = contact.contact
    record["contact_stiffness"] = contact.stiffness
    record["contact_damping"] = contact.damping
    record["sensor_share"] = sensor_share(parameters)
    return constants
