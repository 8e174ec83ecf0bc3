"""Stiffness and damping of the rotor in its loop: the dynamic stiffness at low frequency.

With a force f on the journals in their bearings and displacements y of the journals there, both along all radial axes,
the linearised loop has

    f = K(s) y,    stiffness = Re K(j omega),    damping = Im K(j omega) / omega

at a frequency omega far below all poles but those of slow integral parts, which let the currents drift for seconds. The
inertia m omega^2 in Re K is taken out by a second frequency. For a magnet with ideal iron and currents that
follow at once K(s) = m s^2 + k_i (K_P + K_D s) - k_s. Lag of currents, sampling, delay and sensors by a time tau takes
about k_i K_P tau of the damping k_i K_D; iron, coupled circuits and the currents that carry the weight change k_i and
k_s.

With y_m = G_m f + P_m i measured by the sensors, y = G f + P i of the journals, and the sampled plant P_d from the
currents i = -C y_m of the controller to the measured positions, the currents that a continuous plant would need for the
same effect are P_m^-1 P_d i.

Source: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 2 and 8 (dynamic stiffness).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.linear import LinearSystem
from amb_core.loop.linear_control import linear_law
from amb_core.plant import Plant
from amb_core.plant.averaged import AveragedPlant
from amb_core.plant.differences import plant_axes
from amb_core.plant.linearise import Linearization

_SLOW = 0.03
"""Frequency over the rate of the fastest unstable pole: below the rotor's own motion, above that of integral parts."""


def stiffness_and_damping(plant: Plant, model: Linearization) -> tuple[float, float]:
    """Least stiffness (N/m) and least damping (N s/m) of the radial axes at low frequency.

    Parameters
    ----------
    plant : Plant
        The machine; its state is neither used nor changed.
    model : Linearization
        Its stable loop.
    """
    omega = _SLOW * max(float(model.continuous.poles().real.max()), 1.0)
    first, second = (np.diag(dynamic_stiffness(plant, model, factor * omega)) for factor in (1.0, 2.0))
    without_inertia = (4.0 * first.real - second.real) / 3.0
    return float(without_inertia.min()), float(first.imag.min() / omega)


def dynamic_stiffness(plant: Plant, model: Linearization, omega: float) -> NDArray[np.complex128]:
    """Forces on the journals per displacement of the journals (N/m) at an angular frequency (rad/s).

    Parameters
    ----------
    plant : Plant
        The machine; its state is neither used nor changed.
    model : Linearization
        Its stable loop.
    omega : float
        Angular frequency (rad/s), below the Nyquist frequency.

    Returns
    -------
    ndarray of complex, shape (axes, axes)
        For the radial axes along which the rotor moves.
    """
    continuous, s = model.continuous, 1j * omega
    forces, journals = _at_journals(plant, model)
    inputs, outputs = np.hstack([forces, continuous.b]), np.vstack([continuous.c, journals])
    opened = LinearSystem(continuous.a, inputs, outputs, np.zeros((len(outputs), inputs.shape[1])), 0.0)
    response = opened.at(s)[0]
    by_force, by_current = response[:, : forces.shape[1]], response[:, forces.shape[1] :]
    z = np.exp(s * model.discrete.sample_time)
    sampled = model.discrete.at(z)[0]
    law = linear_law(model.controller, continuous.inputs).at(z)[0][:, continuous.inputs :]  # of the measured positions
    measured = np.linalg.solve(np.eye(continuous.outputs) - sampled @ law, by_force[: continuous.outputs])
    currents = np.linalg.solve(by_current[: continuous.outputs], sampled @ law @ measured)
    return np.asarray(np.linalg.inv((by_force + by_current @ currents)[continuous.outputs :]))


def _at_journals(plant: Plant, model: Linearization) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rates of the states by forces on the journals, shape (n, axes), and their positions by states, (axes, n)."""
    averaged, axes = AveragedPlant(plant), plant_axes(plant)
    names = averaged.names[averaged.coordinates]
    mass, shapes = (
        (plant.parameters.rotor.mass * np.eye(2), np.eye(2))
        if plant.rotor is None
        else (plant.rotor.mass, plant.rotor.bearings)
    )
    accelerations = np.linalg.solve(mass, shapes[axes].T)
    states = list(model.continuous.state_names)
    forces, journals = np.zeros((len(states), len(axes))), np.zeros((len(axes), len(states)))
    for number, name in enumerate(names):
        if name in states:
            forces[states.index(f"v_{name}")] = accelerations[number]
            journals[:, states.index(name)] = shapes[axes, number]
    return forces, journals
