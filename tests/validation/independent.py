"""The kernel against an implicit solution of the same equations, restarted at every switching instant.

Shares with the kernel the reluctances, eddy-current coefficients and windings of the network, and the control law; the
network's equations, the amplifiers and the rotor are written anew, and every coil voltage is constant in a piece.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from row import Row
from scipy.constants import mu_0
from scipy.integrate import solve_ivp

from amb_core.control import ControllerParameters, PdController
from amb_core.plant import Plant

SAMPLES = 200  # 20 ms
FLUX, POSITION, VELOCITY, CHARGE = slice(0, 8), slice(8, 10), slice(10, 12), slice(12, 16)
ANGLES = np.deg2rad(22.5 + 45.0 * np.arange(8))
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
# Wb, m, m/s, A s: what a current of 10 uA or a position of 1 pm would show
ABSOLUTE = np.repeat([1e-12, 1e-13, 1e-11, 1e-12], [8, 2, 2, 4])
FIRST_STEP = 2e-7  # s, a tenth of the shortest eddy-current time constant


def rows() -> Iterator[Row]:
    """Largest deviations in 20 ms of closed loop: a step of 10 um on x at 2 ms, a sine of 5 um and 200 Hz on y."""
    plant = Plant()
    position, current = _implicit(plant)
    traced_position, traced_current = _kernel(plant)
    solver = "against solve_ivp (Radau, rtol 1e-9) over 20 ms"
    yield Row(f"positions {solver}", 1e9 * float(np.abs(traced_position - position).max()), 1.0, "nm")
    yield Row(f"currents {solver}", 1e3 * float(np.abs(traced_current - current).max()), 1.0, "mA")


def _reference(sample: int) -> tuple[float, float]:
    return (10e-6 if sample >= 20 else 0.0), 5e-6 * np.sin(2.0 * np.pi * 200.0 * sample * 1e-4)


def _kernel(plant: Plant) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and coil currents at the start of every switching period."""
    plant.reset()
    controller = PdController(ControllerParameters())
    traces = [plant.trace(*controller.update(*plant.position, *_reference(sample))) for sample in range(SAMPLES)]
    if min(trace.current.min() for trace in traces) <= 0.0:
        raise RuntimeError("a coil current reached zero: the solution to compare with has no diodes")
    period = plant.parameters.steps_per_period
    return (
        np.concatenate([trace.position[::period] for trace in traces]),
        np.concatenate([trace.current[::period] for trace in traces]),
    )


def _implicit(plant: Plant) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same from the implicit solution."""
    parameters = plant.parameters
    amplifier, periods = parameters.amplifier, parameters.steps_per_sample // parameters.steps_per_period
    period = 1.0 / amplifier.switching_frequency
    bearing, controller = Bearing(plant), PdController(ControllerParameters())
    state = np.zeros(16)
    mean, integral = np.full(4, amplifier.bias_current), np.zeros(4)
    state[FLUX] = plant.static_flux(mean, 0.0, 0.0)
    positions, currents = [], []
    for sample in range(SAMPLES):
        control = np.array(controller.update(*state[POSITION], *_reference(sample)))
        wanted = np.clip(amplifier.bias_current + np.concatenate([control, -control]), 0.0, amplifier.current_limit)
        for _ in range(periods):
            positions.append(state[POSITION])
            currents.append(bearing.solved(state, np.full(4, -amplifier.supply_voltage))[8:])
            error = wanted - mean
            following = integral + amplifier.integral_gain * error * period
            duty = 0.5 + amplifier.proportional_gain * error + following
            limited = np.clip(duty, amplifier.minimum_duty, amplifier.maximum_duty)
            integral = np.where(duty == limited, following, integral)
            state = bearing.switching_period(state, limited, period)
            mean = state[CHARGE] / period
    return np.array(positions), np.array(currents)


class Bearing:
    """Network and rotor. State: pole fluxes, position, velocity, charge through the coils in the switching period."""

    def __init__(self, plant: Plant) -> None:
        circuit, self._rotor, network = plant.parameters.magnetic_circuit, plant.parameters.rotor, plant.network
        area = circuit.pole_width * circuit.axial_length
        self._supply = plant.parameters.amplifier.supply_voltage
        self._gap, self._per_gap, self._pull = circuit.air_gap, 1.0 / (mu_0 * area), 1.0 / (2.0 * mu_0 * area)
        self._iron = network.iron_reluctance
        # Unknowns: flux rates (8), magnetic potential between the rings (1), coil currents (4)
        system = np.zeros((13, 13))
        system[:8, :8], system[:8, 8], system[:8, 9:] = network.eddy_coefficient, 1.0, -network.winding
        system[8, :8] = 1.0
        system[9:, :8], system[9:, 9:] = network.winding.T, circuit.coil_resistance * np.eye(4)
        wanted = np.delete(np.linalg.inv(system), 8, axis=0)
        self._by_drop, self._by_voltage = -wanted[:, :8], wanted[:, 9:]

    def switching_period(
        self, state: NDArray[np.float64], duty: NDArray[np.float64], period: float
    ) -> NDArray[np.float64]:
        """The state one switching period later; each coil has the positive voltage for its duty, centred."""
        on, off = 0.5 * period * (1.0 - duty), 0.5 * period * (1.0 + duty)
        state = state.copy()
        state[CHARGE] = 0.0
        for start, end in itertools.pairwise(np.unique(np.concatenate([[0.0, period], on, off]))):
            middle = 0.5 * (start + end)
            voltage = np.where((on < middle) & (middle < off), self._supply, -self._supply)
            solution = solve_ivp(
                self._rates,
                (start, end),
                state,
                method="Radau",
                args=(voltage,),
                jac=self._jacobian,
                rtol=1e-9,
                atol=ABSOLUTE,
                first_step=min(end - start, FIRST_STEP),
            )
            if not solution.success:
                raise RuntimeError(f"solve_ivp failed: {solution.message}")
            state = solution.y[:, -1]
        return state

    def solved(self, state: NDArray[np.float64], voltage: NDArray[np.float64]) -> NDArray[np.float64]:
        """Flux rates (8) and coil currents (4)."""
        drop = self._iron @ state[FLUX] + self._gap_reluctance(state) * state[FLUX]
        return self._by_drop @ drop + self._by_voltage @ voltage

    def _gap_reluctance(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        return (self._gap - DIRECTIONS @ state[POSITION]) * self._per_gap

    def _rates(self, _: float, state: NDArray[np.float64], voltage: NDArray[np.float64]) -> NDArray[np.float64]:
        rates = np.empty(16)
        solved = self.solved(state, voltage)
        rates[FLUX], rates[CHARGE] = solved[:8], solved[8:]
        rates[POSITION] = state[VELOCITY]
        rates[VELOCITY] = self._pull * (state[FLUX] ** 2 @ DIRECTIONS) / self._rotor.mass
        rates[11] -= self._rotor.gravity
        return rates

    def _jacobian(self, _: float, state: NDArray[np.float64], __: NDArray[np.float64]) -> NDArray[np.float64]:
        jacobian = np.zeros((16, 16))
        by_flux = self._by_drop @ (self._iron + np.diag(self._gap_reluctance(state)))
        flux_along = state[FLUX, np.newaxis] * DIRECTIONS
        by_position = -self._by_drop @ (self._per_gap * flux_along)
        jacobian[FLUX, FLUX], jacobian[CHARGE, FLUX] = by_flux[:8], by_flux[8:]
        jacobian[FLUX, POSITION], jacobian[CHARGE, POSITION] = by_position[:8], by_position[8:]
        jacobian[POSITION, VELOCITY] = np.eye(2)
        jacobian[VELOCITY, FLUX] = 2.0 * self._pull * flux_along.T / self._rotor.mass
        return jacobian
