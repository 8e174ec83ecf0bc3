"""Replay of a worst case: the loop with the perturbation in it, whose pole must lie on the unit circle.

A real delta stays a constant. A complex delta is realised as a stable real system of first order, an all-pass

    sigma |delta| (1 - a z)/(z - a),    |a| < 1,

which has the wanted phase at the frequency. So the replayed loop is a real system that could be built.
"""

from __future__ import annotations

import numpy as np

from amb_core.linear import Arrays, Complexes, LinearSystem


def replayed_poles(system: LinearSystem, perturbation: Complexes, frequency: float) -> Complexes:
    """Poles of a system with w = diag(delta) z, largest first.

    Parameters
    ----------
    system : LinearSystem
        From w to z.
    perturbation : ndarray of complex, shape (n,)
        delta.
    frequency : float
        Frequency (Hz) at which complex entries have their phase.
    """
    angle = 2.0 * np.pi * frequency * system.sample_time
    real = np.abs(perturbation.imag) <= 1e-14 * np.abs(perturbation)
    if not 1e-9 < angle < np.pi - 1e-9:  # no phase but 0 and 180 degrees: taken as it is
        return _closed(system, np.zeros((0, 0)), np.zeros((0, len(real))), np.zeros((len(real), 0)), perturbation)
    places = np.flatnonzero(~real)
    size = len(places)
    pole, sign = np.zeros(size), np.ones(size)
    for number, delta in enumerate(perturbation[places]):
        pole[number], sign[number] = _all_pass(float(np.angle(delta)), angle)
    gain = sign * np.abs(perturbation[places])
    b, c = np.zeros((size, len(real))), np.zeros((len(real), size))
    b[np.arange(size), places], c[places, np.arange(size)] = 1.0, gain * (1.0 - pole**2)
    direct = perturbation.real.copy()
    direct[places] = -gain * pole
    return _closed(system, np.diag(pole), b, c, direct)


def distance_from_circle(system: LinearSystem, perturbation: Complexes, frequency: float) -> float:
    """Distance of the replayed loop's pole from its place on the unit circle at the frequency."""
    on_circle = np.exp(2j * np.pi * frequency * system.sample_time)
    return float(np.abs(replayed_poles(system, perturbation, frequency) - on_circle).min())


def _all_pass(phase: float, angle: float) -> tuple[float, float]:
    """Pole a and sign of an all-pass with a phase at an angle of z: without sign its phase lies in (-pi, 0)."""
    sign = 1.0 if -np.pi < phase < 0.0 else -1.0
    wanted = phase if sign > 0.0 else phase - np.pi
    psi = -0.5 * (wanted + angle)
    return float(np.sin(psi) / np.sin(angle + psi)), sign


def _closed(system: LinearSystem, a: Arrays, b: Arrays, c: Arrays, direct: Complexes | Arrays) -> Complexes:
    """Poles of the system with the perturbation c (z - a)^-1 b + diag(direct)."""
    loop = np.linalg.inv(np.eye(len(direct)) - system.d * direct)  # z = loop (C x + D c q)
    z_x, z_q = loop @ system.c, loop @ system.d @ c
    w_x, w_q = direct[:, np.newaxis] * z_x, direct[:, np.newaxis] * z_q + c
    whole = np.block([[system.a + system.b @ w_x, system.b @ w_q], [b @ z_x, a + b @ z_q]])
    poles = np.linalg.eigvals(whole).astype(np.complex128)
    return np.asarray(poles[np.argsort(-np.abs(poles), kind="stable")])
