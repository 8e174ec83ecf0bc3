"""The plant: power amplifiers, magnetic circuit and rotor behind one call per controller sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.errors import PlantError
from amb_core.plant import kernel
from amb_core.plant.network import COILS, POLE_ANGLES, POLES, MagneticNetwork, build_network, flux_constraints
from amb_core.plant.parameters import PlantParameters

_NO_TRACE = np.empty((0, kernel.TRACE_SIZE))


@dataclass(frozen=True)
class Trace:
    """Variables at the start of every internal step.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time from the first row (s).
    flux, flux_rate : ndarray, shape (n, 8)
        Pole fluxes (Wb) and their rates (Wb/s).
    current, voltage : ndarray, shape (n, 4)
        Coil currents (A) and mean coil voltages over the step (V), electromagnets +x, +y, -x, -y.
    position, velocity, force : ndarray, shape (n, 2)
        Rotor position (m), velocity (m/s) and magnetic force (N).
    """

    time: NDArray[np.float64]
    flux: NDArray[np.float64]
    flux_rate: NDArray[np.float64]
    current: NDArray[np.float64]
    voltage: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    force: NDArray[np.float64]


class Plant:
    """One radial bearing with its amplifiers and a point-mass rotor.

    Inputs are the control current references i_x, i_y (A); the amplifiers add the bias current. The output is the
    rotor position x, y (m). `advance` integrates exactly one controller sample.

    Raises
    ------
    PlantError
        If the internal step is too long for the eddy currents of the magnetic circuit.
    """

    def __init__(self, parameters: PlantParameters | None = None) -> None:
        self.parameters = parameters or PlantParameters()
        self.network = build_network(self.parameters.magnetic_circuit)
        self._check_internal_step()
        self._constants = _pack_constants(self.parameters, self.network)
        self._matrices = _pack_matrices(self.network)
        self._work = np.zeros(kernel.WORK_SIZE)
        self._steps = self.parameters.steps_per_sample
        self.sample_time = 1.0 / self.parameters.integration.sample_rate
        self.reset()

    def reset(self) -> None:
        """Rotor at rest at its initial position, bias current in all coils with the fluxes of the steady state."""
        rotor = self.parameters.rotor
        self.delevitated = False
        self.samples = 0
        self._state = np.zeros(kernel.STATE_SIZE)
        self._state[kernel.X], self._state[kernel.Y] = rotor.initial_x, rotor.initial_y
        bias = np.full(COILS, self.parameters.amplifier.bias_current)
        self._state[:POLES] = self.static_flux(bias, rotor.initial_x, rotor.initial_y)
        self._state[kernel.CURRENT_SUM : kernel.CURRENT_SUM + COILS] = bias * self._constants[kernel.PERIOD]
        self._state[kernel.CURRENT_START : kernel.CURRENT_START + COILS] = bias

    @property
    def position(self) -> tuple[float, float]:
        """Rotor position x, y (m)."""
        return float(self._state[kernel.X]), float(self._state[kernel.Y])

    def advance(self, current_x: float, current_y: float) -> tuple[float, float]:
        """Hold the control current references (A) over one controller sample; return the new rotor position (m).

        Once the rotor has touched the backup bearing, `delevitated` is true and further calls are refused.

        Raises
        ------
        PlantError
            If the rotor has delevitated, or a reference or a state is not finite.
        """
        if self.delevitated:
            raise PlantError(f"the rotor delevitated at sample {self.samples}; reset the plant")
        status = kernel.advance(
            self._state, self._constants, self._matrices, self._work, current_x, current_y, self._steps, _NO_TRACE
        )
        self.samples += 1
        if status != kernel.OK:
            self._stop(status, current_x, current_y)
        return float(self._state[kernel.X]), float(self._state[kernel.Y])

    def trace(self, current_x: float, current_y: float, samples: int = 1) -> Trace:
        """Like `samples` calls of `advance` with the same references, returning every internal step."""
        steps = samples * self._steps
        rows = np.empty((steps, kernel.TRACE_SIZE))
        status = kernel.advance(
            self._state, self._constants, self._matrices, self._work, current_x, current_y, steps, rows
        )
        self.samples += samples
        if status != kernel.OK:
            self._stop(status, current_x, current_y)
        columns = np.split(rows, [8, 16, 20, 24, 26, 28], axis=1)
        return Trace(np.arange(steps, dtype=np.float64) * self.parameters.integration.internal_step, *columns)

    def static_flux(self, coil_currents: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
        """Pole fluxes (Wb), shape (8,), of constant coil currents (A), shape (4,), at a rotor position (m)."""
        circuit = self.parameters.magnetic_circuit
        constraints = flux_constraints(circuit.coupling)
        size = POLES + constraints.shape[1]
        system = np.zeros((size, size))
        system[:POLES, :POLES] = self.network.reluctance(x, y, circuit.air_gap)
        system[:POLES, POLES:] = constraints
        system[POLES:, :POLES] = constraints.T
        drive = np.concatenate([self.network.winding @ coil_currents, np.zeros(constraints.shape[1])])
        return np.linalg.solve(system, drive)[:POLES]

    def _check_internal_step(self) -> None:
        """The integrator is stable up to one step per fastest eddy-current time constant; half of that is asked for."""
        gap = self.network.reluctance(0.0, 0.0, self.parameters.magnetic_circuit.air_gap)
        fastest = np.abs(np.linalg.eigvals(self.network.solution[:POLES, :POLES] @ gap)).max()
        step = self.parameters.integration.internal_step
        if step * fastest > 0.5:
            raise PlantError(
                f"integration.internal_step = {step:g} s is too long for the eddy currents, whose shortest time "
                f"constant is {1.0 / fastest:.3g} s; allowed: at most {0.5 / fastest:.3g} s"
            )

    def _stop(self, status: int, current_x: float, current_y: float) -> None:
        if status == kernel.DELEVITATED:
            self.delevitated = True
            return
        time = self.samples * self.sample_time
        if status == kernel.INPUT_NOT_FINITE:
            raise PlantError(
                f"control current references {current_x} A, {current_y} A not finite at sample {self.samples}, "
                f"{time:.6f} s"
            )
        names = {"flux": slice(0, POLES), "rotor": slice(kernel.X, kernel.AX)}
        bad = [name for name, part in names.items() if not np.isfinite(self._state[part]).all()]
        raise PlantError(f"state not finite ({', '.join(bad)}) at sample {self.samples}, {time:.6f} s; reset the plant")


def _pack_constants(parameters: PlantParameters, network: MagneticNetwork) -> NDArray[np.float64]:
    amplifier, rotor = parameters.amplifier, parameters.rotor
    constants = np.zeros(kernel.CONSTANTS_SIZE)
    constants[kernel.STEP] = parameters.integration.internal_step
    constants[kernel.GAP] = parameters.magnetic_circuit.air_gap
    constants[kernel.GAP_RELUCTANCE] = network.gap_reluctance
    constants[kernel.FORCE] = 1.0 / (2.0 * mu_0 * network.pole_area)
    constants[kernel.MASS] = rotor.mass
    constants[kernel.GRAVITY] = rotor.gravity
    constants[kernel.RADIUS] = rotor.backup_bearing_radius
    constants[kernel.SUPPLY] = amplifier.supply_voltage
    constants[kernel.DUTY_MIN] = amplifier.minimum_duty
    constants[kernel.DUTY_MAX] = amplifier.maximum_duty
    constants[kernel.KP] = amplifier.proportional_gain
    constants[kernel.KI] = amplifier.integral_gain
    constants[kernel.BIAS] = amplifier.bias_current
    constants[kernel.CURRENT_MAX] = amplifier.current_limit
    # A switching period of one internal step has the average voltage as its only pulse.
    constants[kernel.PERIOD] = parameters.steps_per_period if amplifier.switching else 1
    constants[kernel.UNIPOLAR] = float(amplifier.unipolar)
    return constants


def _pack_matrices(network: MagneticNetwork) -> NDArray[np.float64]:
    matrices = np.zeros((kernel.MATRICES_SIZE, POLES + COILS))
    matrices[kernel.RELUCTANCE : kernel.RELUCTANCE + POLES, :POLES] = network.iron_reluctance
    matrices[kernel.SOLUTION : kernel.SOLUTION + POLES + COILS] = network.solution.T
    matrices[kernel.COSINE, :POLES] = np.cos(POLE_ANGLES)
    matrices[kernel.SINE, :POLES] = np.sin(POLE_ANGLES)
    return matrices
