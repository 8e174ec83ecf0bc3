"""The plant with averaged amplifiers as an ordinary differential equation: the reference for kernel and linearisation.

State s, shape (16,): pole fluxes phi_0..phi_7 (Wb), position x, y (m), velocity v_x, v_y (m/s), and the integral parts
I_c of the current controllers (-) of electromagnets +x, +y, -x, -y. With coil current references r_c = clip(i_0 + i_x,
0, i_max) (i_0 - i_x for -x, i_y likewise), supply voltage U and the network of `amb_core.plant.network`,

    e_c = r_c - i_c,    d_c = clip(1/2 + K_P e_c + I_c, d_min, d_max),    V_c = U (2 d_c - 1)
    (dphi/dt, i) = M (h, V),    h = diag(g_j / (mu_0 A)) phi + R phi
    dI_c/dt = K_I e_c, or 0 while the duty is at a limit
    m dv/dt = sum_j phi_j^2 / (2 mu_0 A) (cos theta_j, sin theta_j) - (0, m g),    dposition/dt = v

Eddy currents let part of a coil current follow its voltage at once (M has a block from V to i), so V and i are solved
for together. A unipolar coil whose current would be negative takes the voltage that keeps it zero.

Written for clarity, independently of the compiled kernel, which holds the duty over each switching period (over each
internal step with `switching` off) and thereby approaches these equations, to first order, as that period vanishes:
its currents lag their references less by about one period, whose mean current is the one before it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.plant.network import COIL_AXES, COILS, POLE_ANGLES, POLES, pole_gaps
from amb_core.plant.plant import Plant

FLUX, POSITION, VELOCITY, INTEGRAL = slice(0, 8), slice(8, 10), slice(10, 12), slice(12, 16)
STATE_SIZE = 16
STATE_NAMES = (
    *(f"flux_{pole}" for pole in range(POLES)),
    *("x", "y", "v_x", "v_y"),
    *("integral_+x", "integral_+y", "integral_-x", "integral_-y"),
)

POLE_DIRECTIONS = np.column_stack([np.cos(POLE_ANGLES), np.sin(POLE_ANGLES)])
_SWEEPS = 200
_VOLTAGE_TOLERANCE = 1e-10  # V; makes 1e-14 A through the eddy currents' conductance


def averaged_rates(
    state: NDArray[np.float64], current_reference: NDArray[np.float64], plant: Plant
) -> NDArray[np.float64]:
    """Right-hand side of the averaged plant.

    Parameters
    ----------
    state : ndarray, shape (16,)
        Fluxes, position, velocity, integral parts; see above.
    current_reference : ndarray, shape (2,)
        Control current references i_x, i_y (A); the amplifiers add the bias current.
    plant : Plant
        Gives parameters and network; its own state is neither used nor changed.

    Returns
    -------
    ndarray, shape (16,)
        ds/dt.
    """
    amplifier, rotor = plant.parameters.amplifier, plant.parameters.rotor
    voltage, current = amplifier_output(state, current_reference, plant)
    drive = np.concatenate([flux_drops(state, plant), voltage])
    error = coil_references(current_reference, plant) - current
    duty = 0.5 + amplifier.proportional_gain * error + state[INTEGRAL]
    inside = (amplifier.minimum_duty <= duty) & (duty <= amplifier.maximum_duty)
    rates = np.empty(STATE_SIZE)
    rates[FLUX] = plant.network.solution[:POLES] @ drive
    rates[POSITION] = state[VELOCITY]
    rates[VELOCITY] = magnetic_force(state[FLUX], plant) / rotor.mass - np.array([0.0, rotor.gravity])
    rates[INTEGRAL] = np.where(inside, amplifier.integral_gain * error, 0.0)
    return rates


def amplifier_output(
    state: NDArray[np.float64], current_reference: NDArray[np.float64], plant: Plant
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Averaged coil voltages (V) and coil currents (A), each of shape (4,), that fit together in a state."""
    amplifier = plant.parameters.amplifier
    conductance = plant.network.solution[POLES:, POLES:]
    # The coil currents without what their voltages drive at once.
    flux_current = plant.network.solution[POLES:, :POLES] @ flux_drops(state, plant)
    gain = 2.0 * amplifier.supply_voltage * amplifier.proportional_gain
    demand = gain * coil_references(current_reference, plant) + 2.0 * amplifier.supply_voltage * state[INTEGRAL]
    lowest, highest = (
        amplifier.supply_voltage * (2.0 * duty - 1.0) for duty in (amplifier.minimum_duty, amplifier.maximum_duty)
    )
    # V = demand - gain (flux_current + conductance V) inside the limits. With limits and diodes V minimises a convex
    # function whose kinks belong to single coils, so solving coil by coil finds it (Gauss-Seidel).
    voltage = np.asarray(
        np.linalg.solve(np.eye(COILS) + gain * conductance, demand - gain * flux_current), dtype=np.float64
    )
    for _ in range(_SWEEPS):
        before = voltage.copy()
        for coil in range(COILS):
            own = conductance[coil, coil]
            others = flux_current[coil] + conductance[coil] @ voltage - own * voltage[coil]
            wanted = (demand[coil] - gain * others) / (1.0 + gain * own)
            voltage[coil] = min(max(wanted, lowest), highest)
            if amplifier.unipolar and others + own * voltage[coil] < 0.0:
                voltage[coil] = -others / own
        if np.abs(voltage - before).max() <= _VOLTAGE_TOLERANCE:
            break
    return voltage, flux_current + conductance @ voltage


def coil_references(current_reference: NDArray[np.float64], plant: Plant) -> NDArray[np.float64]:
    """Coil current references (A), shape (4,), from the control current references i_x, i_y (A)."""
    amplifier = plant.parameters.amplifier
    return np.clip(amplifier.bias_current + COIL_AXES @ current_reference, 0.0, amplifier.current_limit)


def flux_drops(state: NDArray[np.float64], plant: Plant) -> NDArray[np.float64]:
    """Magnetomotive force drops h (A) along gap and iron of each pole, shape (8,)."""
    x, y = state[POSITION]
    gaps = pole_gaps(x, y, plant.parameters.magnetic_circuit.air_gap)
    return gaps * plant.network.gap_reluctance * state[FLUX] + plant.network.iron_reluctance @ state[FLUX]


def magnetic_force(flux: NDArray[np.float64], plant: Plant) -> NDArray[np.float64]:
    """Force on the rotor (N), shape (2,), of pole fluxes (Wb), shape (8,)."""
    return (flux**2 / (2.0 * mu_0 * plant.network.pole_area)) @ POLE_DIRECTIONS


def initial_state(plant: Plant) -> NDArray[np.float64]:
    """State after `Plant.reset`: rotor at rest at its initial position, fluxes of the bias currents, no integral."""
    rotor = plant.parameters.rotor
    state = np.zeros(STATE_SIZE)
    state[FLUX] = plant.static_flux(
        np.full(COILS, plant.parameters.amplifier.bias_current), rotor.initial_x, rotor.initial_y
    )
    state[POSITION] = rotor.initial_x, rotor.initial_y
    return state
