"""Our kernel against scipy's LSODA on the same averaged plant, both as loose as they may be within 1 nm.

Simulated are 50 ms of closed loop: from a levitated state a step of 10 um along x, the PD controller's references held
over each sample of 0.1 ms; amplifiers averaged (`amplifier.switching: false`), the rest is the paper's plant. The
reference is LSODA at a relative tolerance of 1e-9. All sampled positions must be within 1 nm of it: LSODA is timed at
the loosest tolerance, in half decades, and the kernel at the longest of a few internal steps with which they are. The
kernel holds duty cycles over an internal step, and its error is of first order in it.

`solve_ivp_ratio` takes the right-hand side that a user would write, in numpy (`AveragedPlant.derivative`);
`solve_ivp_compiled_ratio` the same equations compiled by numba, which leaves the methods and scipy's own overhead.
"""

from __future__ import annotations

import copy
import statistics
import time
from collections.abc import Callable, Iterable

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import AmplifierParameters, IntegrationParameters, Plant, PlantParameters
from amb_core.plant.averaged import AveragedPlant, coil_references
from amb_core.plant.network import COILS, POLE_ANGLES, POLES

SAMPLES = 500
TARGET = 10e-6  # m
ACCURACY = 1e-9  # m
REFERENCE_TOLERANCE = 1e-9
TOLERANCES = 10.0 ** np.arange(-3.0, -8.0, -0.5)
INTERNAL_STEPS = (0.5e-6, 0.25e-6, 0.1e-6, 0.05e-6, 0.04e-6)  # s
LEVITATION = 2_000  # samples until the rotor is at rest
DERIVATIVE_TOLERANCE = 1e-9
REPETITIONS = 5  # of the runs that take little time

POSITION = slice(POLES + COILS, POLES + COILS + 2)  # in the averaged state: fluxes, integral parts, position, velocity
SCALES = np.concatenate([np.full(POLES, 1e-4), np.full(COILS, 1e-3), np.full(2, 1e-5), np.full(2, 1e-3)])
"""Magnitudes of the states: fluxes (Wb), integral parts (-), position (m), velocity (m/s)."""

Derivative = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""From state and control current references (A) to ds/dt."""


def measure(samples: int = SAMPLES) -> dict[str, float | bool]:
    """Ratios of the times of LSODA and kernel, the errors of both (m), and the tolerance and step (s) they are from.

    Raises
    ------
    RuntimeError
        If kernel or LSODA miss the accuracy, or the compiled equations are not those of `AveragedPlant`.
    """
    start = Start()
    averaged = start.averaged
    compiled = compiled_derivative(averaged)
    _check_derivative(averaged, compiled)
    reference = solve(start, compiled, REFERENCE_TOLERANCE, samples)

    step, kernel_error = _loosest(lambda step: Start(step).run_kernel(samples), INTERNAL_STEPS, reference)
    tolerance, error = _loosest(
        lambda tolerance: solve(start, compiled, tolerance, samples), TOLERANCES.tolist(), reference
    )
    fast = Start(step)
    kernel_time = statistics.median(_duration(lambda: fast.run_kernel(samples)) for _ in range(REPETITIONS))
    compiled_time = min(_duration(lambda: solve(start, compiled, tolerance, samples)) for _ in range(REPETITIONS))
    numpy_time = _duration(lambda: solve(start, averaged.derivative, tolerance, samples))
    return {
        "solve_ivp_ratio": numpy_time / kernel_time,
        "solve_ivp_compiled_ratio": compiled_time / kernel_time,
        "solve_ivp_tolerance": tolerance,
        "solve_ivp_error": error,
        "averaged_kernel_step": step,
        "averaged_kernel_error": kernel_error,
    }


class Start:
    """A levitated rotor, from which runs start as often as wanted."""

    def __init__(self, internal_step: float = INTERNAL_STEPS[0]) -> None:
        integration = IntegrationParameters(internal_step=internal_step)
        self._plant = Plant(PlantParameters(amplifier=AmplifierParameters(switching=False), integration=integration))
        self._controller = PdController(ControllerParameters())
        for _ in range(LEVITATION):
            self._plant.advance(self._controller.update(self._plant.position, (0.0, 0.0)))
        self.averaged = AveragedPlant(self._plant)

    def controller(self) -> PdController:
        """The controller, which remembers the rotor."""
        return copy.deepcopy(self._controller)

    def state(self) -> NDArray[np.float64]:
        """That of `AveragedPlant`."""
        bearing = self._plant._arrays.bearings[0]
        return np.concatenate([bearing[name] for name in ("flux", "integral", "position", "velocity")])

    def run_kernel(self, samples: int) -> NDArray[np.float64]:
        """Positions (m) at the samples, shape (samples, 2)."""
        plant, controller = copy.deepcopy(self._plant), self.controller()
        positions = np.empty((samples, 2))
        for sample in range(samples):
            positions[sample] = plant.advance(controller.update(plant.position, (TARGET, 0.0)))
        return positions


def solve(start: Start, derivative: Derivative, tolerance: float, samples: int) -> NDArray[np.float64]:
    """The same by LSODA, started anew at every sample, where the references jump."""
    controller, state, sample_time = start.controller(), start.state(), start.averaged.plant.sample_time
    positions = np.empty((samples, 2))
    for sample in range(samples):
        references = np.array(controller.update(state[POSITION], (TARGET, 0.0)))
        solution = solve_ivp(
            lambda _, s, references=references: derivative(s, references),
            (0.0, sample_time),
            state,
            method="LSODA",
            rtol=tolerance,
            atol=tolerance * SCALES,
        )
        if not solution.success:
            raise RuntimeError(f"LSODA ended at sample {sample}: {solution.message}")
        state = solution.y[:, -1]
        positions[sample] = state[POSITION]
    return positions


def _loosest(
    run: Callable[[float], NDArray[np.float64]], settings: Iterable[float], reference: NDArray[np.float64]
) -> tuple[float, float]:
    """First of the settings whose positions are accurate, and their largest error (m)."""
    for setting in settings:
        error = float(np.abs(run(setting) - reference).max())
        if error <= ACCURACY:
            return setting, error
    raise RuntimeError(f"error is {error:.3g} m with the finest setting, {setting:g}; allowed: {ACCURACY:g} m")


def _check_derivative(averaged: AveragedPlant, compiled: Derivative) -> None:
    """The compiled equations are the same, at voltage limits and diodes too."""
    generator = np.random.default_rng(0)
    for _ in range(200):
        state = averaged.initial_state() + SCALES * generator.standard_normal(averaged.size)
        references = generator.standard_normal(2)
        expected = averaged.derivative(state, references)
        difference = np.abs(compiled(state, references) - expected).max() / np.abs(expected).max()
        if not difference <= DERIVATIVE_TOLERANCE:
            raise RuntimeError(f"compiled derivative differs by {difference:.3g}; allowed: {DERIVATIVE_TOLERANCE:g}")


def _duration(run: Callable[[], object]) -> float:
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def compiled_derivative(averaged: AveragedPlant) -> Derivative:
    """`AveragedPlant.derivative` for one bearing with linear iron and a point mass, compiled."""
    plant = averaged.plant
    parameters, network = plant.parameters, plant.network
    amplifier, rotor = parameters.amplifier, parameters.rotor
    solution = network.averaged_solution
    conductance = np.ascontiguousarray(solution[POLES:, POLES:])
    supply = amplifier.supply_voltage
    gain = 2.0 * supply * amplifier.proportional_gain
    unlimited = np.linalg.inv(np.eye(COILS) + gain * conductance)
    lowest, highest = (supply * (2.0 * duty - 1.0) for duty in (amplifier.minimum_duty, amplifier.maximum_duty))
    directions = np.array([np.cos(POLE_ANGLES), np.sin(POLE_ANGLES)])
    per_flux_squared = 0.5 * network.gap_reluctance  # 1 / (2 mu_0 A)
    by_drops, by_voltage = (
        np.ascontiguousarray(solution[:POLES, :POLES]),
        np.ascontiguousarray(solution[:POLES, POLES:]),
    )
    current_by_drops = np.ascontiguousarray(solution[POLES:, :POLES])
    iron, gap_reluctance, gap = network.iron_reluctance, network.gap_reluctance, parameters.magnetic_circuit.air_gap
    integral_gain, proportional_gain = amplifier.integral_gain, amplifier.proportional_gain
    mass, weight = rotor.mass, np.array([0.0, rotor.gravity])

    @numba.njit(error_model="numpy")
    def derivative(state, coil_reference):
        flux, integral, position = state[0:8], state[8:12], state[12:14]
        drops = (gap - position @ directions) * gap_reluctance * flux + iron @ flux
        flux_current = current_by_drops @ drops
        demand = gain * coil_reference + 2.0 * supply * integral
        voltage = unlimited @ (demand - gain * flux_current)
        current = flux_current + conductance @ voltage
        if voltage.min() < lowest or voltage.max() > highest or current.min() < 0.0:
            settle(voltage, flux_current, demand)
            current = flux_current + conductance @ voltage
        error = coil_reference - current
        duty = 0.5 + proportional_gain * error + integral
        result = np.empty(16)
        result[0:8] = by_drops @ drops + by_voltage @ voltage
        for coil in range(4):
            free = lowest <= supply * (2.0 * duty[coil] - 1.0) <= highest
            result[8 + coil] = integral_gain * error[coil] if free else 0.0
        result[12:14] = state[14:16]
        result[14:16] = directions @ (per_flux_squared * flux**2) / mass - weight
        return result

    @numba.njit(error_model="numpy")
    def settle(voltage, flux_current, demand):
        """Limits and diodes, coil by coil."""
        for _ in range(200):
            largest = 0.0
            for coil in range(4):
                own, before = conductance[coil, coil], voltage[coil]
                others = flux_current[coil] - own * before
                for other in range(4):
                    others += conductance[coil, other] * voltage[other]
                wanted = min(max((demand[coil] - gain * others) / (1.0 + gain * own), lowest), highest)
                voltage[coil] = max(wanted, -others / own)
                largest = max(largest, abs(voltage[coil] - before))
            if largest <= 1e-10:
                return

    return lambda state, references: derivative(state, coil_references(references, plant))


if __name__ == "__main__":
    print(measure())
