"""The integrator of the plant: compiled, on records and plain arrays, strict IEEE arithmetic.

One internal step of length h advances fluxes and rotor by the second-order Adams-Bashforth method,

    y(t + h) = y(t) + h (3/2 dy/dt(t) - 1/2 dy/dt(t - h)),

but for the coil voltages, which enter with their exact mean over the step: the volt-seconds of every switching instant
are right wherever in the step it falls. No fast-math: the same samples come out wherever the kernel is called from.

The equations stand where they are computed: `circuit` (fluxes, currents, forces), `amplifiers`, `rotor`, and beyond the
paper's table `iron`, `iron_paths`, `stiff_iron`, `solid_journal`, `laminations` and `quasistatic`. The paper's bearing,
one or two of them, has a loop without the latter.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.plant.kernel import circuit
from amb_core.plant.kernel.amplifiers import (
    any_negative_current,
    block_negative_currents,
    count_step,
    set_references,
    set_shifted_voltages,
    set_voltages,
)
from amb_core.plant.kernel.iron_paths import add_iron_drops
from amb_core.plant.kernel.laminations import correct_rates, diffuse, set_mean_drops
from amb_core.plant.kernel.quasistatic import balance_fluxes
from amb_core.plant.kernel.records import DELEVITATED, GAP_CLOSED, LINEAR, NOT_FINITE, OK
from amb_core.plant.kernel.rotor import move_modes, move_point_mass, sense, set_contact_force, set_disturbance
from amb_core.plant.kernel.solid_journal import add_diffusion_drops
from amb_core.plant.kernel.stiff_iron import finish_iron_step
from amb_core.plant.kernel.trace import write_trace


class Arrays(NamedTuple):
    """The plant as records (`amb_core.plant.kernel.records`) and arrays, made by `amb_core.plant.packing`.

    Attributes
    ----------
    constants : ndarray of CONSTANTS, shape (1,)
        The plant's parameters.
    state : ndarray of STATE, shape (1,)
        What all bearings share, changed by every step.
    bearings : ndarray of BEARING, shape (bearings,)
        State and last currents and forces of each bearing, changed by every step.
    modes : ndarray, shape (19 + 2 n, n)
        The rotor's n coordinates and their equation of motion (`kernel.rotor`); shape (0, 0) for a point mass.
    """

    constants: NDArray[Any]
    state: NDArray[Any]
    bearings: NDArray[Any]
    modes: NDArray[np.float64]


@numba.njit(cache=True, error_model="numpy")
def advance(constants, state, bearings, modes, references, steps, trace):
    """Advance the plant by `steps` internal steps with the control current references held.

    Parameters
    ----------
    constants, state, bearings, modes : ndarray
        The plant's `Arrays`; state, bearings and modes are changed in place.
    references : ndarray, shape (2 * bearings,)
        Control current references x, y of each bearing (A), finite.
    steps : int
        Internal steps.
    trace : ndarray, shape (steps, m) or (0, m)
        Receives the variables at the start of every internal step if it has rows.

    Returns
    -------
    int
        OK, DELEVITATED (a journal touched its backup bearing), NOT_FINITE, or GAP_CLOSED (a journal reached the poles
        in spite of the backup bearing).
    """
    # Taken out of their arrays once: compiled code reads fields of a record faster than those of an element.
    plant, shared, first = constants[0], state[0], bearings[0]
    for n in range(bearings.shape[0]):
        set_references(plant.amplifier, bearings[n], references[2 * n], references[2 * n + 1])
    if bearings.shape[0] == 1 and trace.shape[0] == 0 and not plant.extended:
        # The paper's bearing has a loop of its own, out of which the compiler leaves the rest.
        for _ in range(steps):
            _step_circuit(plant, shared, first, False)
            circuit.integrate(plant, first)
            move_point_mass(plant, shared, first)
            count_step(plant, shared)
    elif bearings.shape[0] == 2 and trace.shape[0] == 0 and not plant.extended:
        # So has a rotor in two of them.
        second = bearings[1]
        for _ in range(steps):
            _step_circuit(plant, shared, first, False)
            circuit.integrate(plant, first)
            _step_circuit(plant, shared, second, False)
            circuit.integrate(plant, second)
            move_modes(plant, shared, bearings, modes)
            count_step(plant, shared)
    else:
        for step in range(steps):
            # With its place known to the compiler, the first bearing takes less time.
            _step_circuit(plant, shared, first, True)
            for n in range(1, bearings.shape[0]):
                _step_other_circuit(plant, shared, bearings[n])
            if plant.rotor.disturbed:
                set_disturbance(plant, shared)
            if trace.shape[0] > 0:
                write_trace(plant, bearings, modes, trace[step])
            for n in range(bearings.shape[0]):
                if plant.diffusion:
                    diffuse(plant, bearings[n])
                circuit.integrate(plant, bearings[n])
            if modes.shape[1] == 0:
                move_point_mass(plant, shared, first)
            else:
                move_modes(plant, shared, bearings, modes)
            if plant.sensor_share != 1.0:
                sense(plant, shared, bearings, modes)
            count_step(plant, shared)
    if plant.sensor_share == 1.0:
        sense(plant, shared, bearings, modes)
    return _status(plant, bearings)


@numba.njit(inline="always", error_model="numpy")
def _step_circuit(constants, state, bearing, extended):
    """Amplifiers and fluxes of a bearing over one internal step, and its forces at the start of the step.

    Without `extended`, those of the paper's table.
    """
    if extended and constants.quasistatic:
        balance_fluxes(constants, bearing)
    if extended and constants.diffusion:
        for j in range(bearing.drop.size):
            bearing.drop[j] = 0.0
    else:
        circuit.set_gap_drops(constants, bearing, not extended or constants.linear_iron)
    if extended and constants.iron != LINEAR:
        add_iron_drops(constants, bearing, state.started)
    if extended and constants.diffusion:
        set_mean_drops(constants, bearing, state.started)
    else:
        if extended and constants.solid_journal:
            add_diffusion_drops(constants.journal, bearing, state.started)
        circuit.extrapolate_drops(constants, bearing, state.started)
    if not extended or constants.amplifier.plain_carriers:
        set_voltages(constants.amplifier, bearing, state.phase, constants.step)
    else:
        set_shifted_voltages(constants.amplifier, bearing, state.phase, constants.step)
    circuit.set_rates(constants, bearing)
    if extended and constants.diffusion:
        correct_rates(constants, bearing)
    if constants.amplifier.unipolar and any_negative_current(bearing):
        block_negative_currents(constants, bearing)
    if extended and constants.iron != LINEAR and not constants.quasistatic:
        finish_iron_step(constants, bearing, state.started)
    circuit.set_pull(constants, bearing)
    if extended and constants.rotor.contact:
        set_contact_force(constants.rotor, bearing)


@numba.njit(cache=True, error_model="numpy")
def _step_other_circuit(constants, state, bearing):
    _step_circuit(constants, state, bearing, True)


@numba.njit(cache=True, error_model="numpy")
def _status(constants, bearings):
    largest = 0.0
    for n in range(bearings.shape[0]):
        x, y = bearings[n].position[0], bearings[n].position[1]
        square = x * x + y * y
        if not math.isfinite(square):
            return NOT_FINITE
        largest = max(largest, square)
    if constants.rotor.contact:
        return GAP_CLOSED if largest >= constants.gap * constants.gap else OK
    return DELEVITATED if largest >= constants.rotor.backup_radius * constants.rotor.backup_radius else OK
