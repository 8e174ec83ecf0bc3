"""The averaged plant differentiated about an operating point, by central differences of its right-hand side.

Its fluxes obey E^T phi = 0, so one flux of each circuit is left out: it is minus the sum of the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.linear import LinearSystem
from amb_core.plant.averaged import AveragedPlant, flux_embedding
from amb_core.plant.network import COILS, POLES, active_coils
from amb_core.plant.operating_point import OperatingPoint
from amb_core.plant.plant import Plant

_RELATIVE_STEP = 1e-4
"""Step of the differences over air gap, 1 m/s, 1 A and the flux that 1 A makes; rounding then takes 1e-11."""
_COIL_NAMES = ("+x", "+y", "-x", "-y")


@dataclass(frozen=True)
class OpenPlant:
    """The plant without current controllers: dx/dt = A x + B V, i = C x + D V; all signals are deviations.

    Attributes
    ----------
    a, b, c, d : ndarray
        Matrices; coil voltages V (V) and coil currents i (A) of the electromagnets that have an amplifier.
    sensors : ndarray, shape (axes, n)
        Map from the states x to the measured positions (m).
    states, coils : list of str
        Names of the states and of the electromagnets.
    """

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]
    sensors: NDArray[np.float64]
    states: list[str]
    coils: list[str]


def linear_plant(plant: Plant, point: OperatingPoint) -> LinearSystem:
    """The averaged plant from control currents (A) to measured positions (m) about an operating point, continuous."""
    averaged = AveragedPlant(plant)
    kept, embedding = _independent_states(averaged)
    axes = plant_axes(plant)
    by_axis = np.eye(2 * plant.bearings)[axes]

    def rates(deviation: NDArray[np.float64]) -> NDArray[np.float64]:
        state = point.state + embedding @ deviation[: len(kept)]
        return averaged.derivative(state, point.current_reference + deviation[len(kept) :] @ by_axis)[kept]

    slopes = _differences(rates, np.concatenate([_scales(averaged)[kept], np.ones(len(axes))]))
    a, b = np.split(slopes, [len(kept)], axis=1)
    c = averaged.sensors()[axes] @ embedding
    labels = axis_labels(plant)
    names = [averaged.names[n] for n in kept]
    a, b, c, states = with_low_pass(a, b, c, names, plant.parameters.sensor.bandwidth, labels)
    return plant_system(a, b, c, 0.0, labels, states)


def open_plant(plant: Plant, point: OperatingPoint) -> OpenPlant:
    """The averaged plant from coil voltages to coil currents and measured positions about an operating point.

    Without proportional gain the integral parts I alone make the voltages, 2 U I: they are the inputs then.
    """
    parameters = plant.parameters
    amplifier = parameters.amplifier.model_copy(update={"proportional_gain": 0.0, "integral_gain": 1.0})
    closed = AveragedPlant(plant)
    averaged = AveragedPlant(Plant(parameters.model_copy(update={"amplifier": amplifier})))
    kept, embedding = _independent_states(averaged)
    supply = amplifier.supply_voltage
    at_rest = point.state.copy()
    currents = closed.currents(point.state, point.current_reference).reshape(-1, COILS)
    lost = amplifier.dead_time * amplifier.switching_frequency
    for bearing, of_bearing in enumerate(currents):
        at_rest[averaged.integral[bearing]] = (
            parameters.magnetic_circuit.coil_resistance * of_bearing / (2.0 * supply) + lost
        )
    driven = np.isin(kept, np.concatenate([np.arange(one.start, one.stop) for one in averaged.integral]))
    coils = [
        bearing * COILS + coil
        for bearing in range(plant.bearings)
        for coil in active_coils(parameters.magnetic_circuit)
    ]

    def rates_and_currents(deviation: NDArray[np.float64]) -> NDArray[np.float64]:
        state = at_rest + embedding @ deviation
        rates = averaged.derivative(state, point.current_reference)[kept]
        return np.concatenate([rates[~driven], averaged.currents(state, point.current_reference)[coils]])

    slopes = _differences(rates_and_currents, _scales(averaged)[kept])
    slopes = np.hstack([slopes[:, ~driven], slopes[:, driven] / (2.0 * supply)])
    order = int(np.sum(~driven))
    (a, b), (c, d) = (np.split(rows, [order], axis=1) for rows in np.split(slopes, [order]))
    sensors = (averaged.sensors()[plant_axes(plant)] @ embedding)[:, ~driven]
    states = [averaged.names[n] for n in kept[~driven]]
    a, b, sensors, states = with_low_pass(a, b, sensors, states, parameters.sensor.bandwidth, axis_labels(plant))
    c = np.hstack([c, np.zeros((len(c), len(a) - c.shape[1]))])
    suffixes = ("",) if plant.bearings == 1 else ("_a", "_b")
    names = [f"{_COIL_NAMES[coil % COILS]}{suffixes[coil // COILS]}" for coil in coils]
    return OpenPlant(a, b, c, d, sensors, states, names)


def plant_system(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    sample_time: float,
    labels: list[str],
    states: list[str],
) -> LinearSystem:
    """A linear system from control currents (A) to measured positions (m) of some axes, without direct feedthrough."""
    axes = len(labels)
    currents = [f"i_{label}" for label in labels]
    d = np.zeros((axes, axes))
    return LinearSystem(a, b, c, d, sample_time, currents, labels, ["A"] * axes, ["m"] * axes, states)


def plant_axes(plant: Plant) -> list[int]:
    """Radial axes along which the rotor moves, 2 * bearing + 0 for x, 1 for y."""
    return [axis for axis in range(2 * plant.bearings) if "xy"[axis % 2] in plant.axes]


def axis_labels(plant: Plant) -> list[str]:
    """Names of the radial axes along which the rotor moves."""
    return [plant.machine.axis_names[axis] for axis in plant_axes(plant)]


def with_low_pass(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    states: list[str],
    bandwidth: float,
    labels: list[str],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], list[str]]:
    """A model with the sensors' low-pass, if they have one (bandwidth in Hz), as a further state for each axis."""
    if bandwidth == 0.0:
        return a, b, c, states
    rate, outputs = 2.0 * np.pi * bandwidth, len(c)
    a = np.block([[a, np.zeros((len(a), outputs))], [rate * c, -rate * np.eye(outputs)]])
    b = np.vstack([b, np.zeros((outputs, b.shape[1]))])
    return a, b, np.hstack([np.zeros_like(c), np.eye(outputs)]), [*states, *(f"sensed_{label}" for label in labels)]


def _differences(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]], scales: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Jacobian at zero by central differences."""
    steps = np.diag(_RELATIVE_STEP * scales)
    return np.column_stack([(function(step) - function(-step)) / (2.0 * step.sum()) for step in steps])


def _independent_states(averaged: AveragedPlant) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Indices of the states without constraints, and the map from these states to all states."""
    plant = averaged.plant
    poles, fluxes = flux_embedding(plant)
    left_out = np.setdiff1d(np.arange(POLES), poles)
    # Without integral gain the integral parts are constant: they are not states of the linear model.
    integrating = active_coils(plant.parameters.magnetic_circuit) if plant.parameters.amplifier.integral_gain else ()
    embedding = np.eye(averaged.size)
    kept = np.ones(averaged.size, dtype=bool)
    for bearing in range(plant.bearings):
        first = averaged.flux[bearing].start
        embedding[np.ix_(first + np.arange(POLES), first + poles)] = fluxes
        kept[first + left_out] = False
        memory = np.arange(averaged.memory[bearing].start, averaged.memory[bearing].stop)
        for term in memory.reshape(-1, POLES):  # memories sum to zero as the fluxes do
            embedding[np.ix_(term, term[poles])] = fluxes
            kept[term[left_out]] = False
        kept[averaged.integral[bearing]] = False
        kept[averaged.integral[bearing].start + np.array(integrating, dtype=np.intp)] = True
    if "x" not in plant.axes:
        kept[[averaged.coordinates.start, averaged.rates.start]] = False
    return np.flatnonzero(kept), embedding[:, kept]


def _scales(averaged: AveragedPlant) -> NDArray[np.float64]:
    circuit, network = averaged.plant.parameters.magnetic_circuit, averaged.plant.network
    scales = np.ones(averaged.size)
    for bearing in range(averaged.plant.bearings):
        # Fluxes, circulating fluxes and memories are contiguous
        fluxes = slice(averaged.flux[bearing].start, averaged.integral[bearing].start)
        scales[fluxes] = circuit.turns_per_pole / (network.gap_reluctance * circuit.air_gap)
    scales[averaged.coordinates] = circuit.air_gap
    return scales
