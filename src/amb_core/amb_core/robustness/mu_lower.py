"""Lower bound of mu: a perturbation that makes a loop singular at a frequency.

With Q = diag(q), |q_i| <= 1, real where the perturbation is real, an eigenvalue of M Q that is real and positive, of
value lambda, is a lower bound, and Q/lambda the perturbation. Candidates for Q come from the power iteration of Young
and Doyle with several starts and are improved by coordinate ascent. Where a perturbation is complex, all complex q are
turned together until the eigenvalue is real; where none is, the frequency is moved instead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from amb_core.robustness.lti import Arrays, Complexes, Lti

_STARTS = 12
_STEPS = 60  # of the power iteration
_TURNS = 24  # angles at which an eigenvalue is followed through a turn of the complex perturbations
_SPAN = 0.3  # of the frequency, either way, within which real perturbations may find another
_POINTS = 241

Found = tuple[float, float, Complexes]


def lower_bound(system: Lti, real: NDArray[np.bool_], frequency: float, seed: int = 0) -> Found:
    """Lower bound of mu near a frequency.

    Parameters
    ----------
    system : Lti
        M.
    real : ndarray of bool, shape (n,)
        Which perturbations are real.
    frequency : float
        Frequency (Hz).
    seed : int
        Of the starts.

    Returns
    -------
    tuple
        The bound, its frequency (Hz), and the perturbation, shape (n,); 0 and an empty one if none was found.
    """
    matrix = system.response(np.array([frequency]))[0]
    random = np.random.default_rng(seed)
    candidates = [_iterated(matrix, real, random) for _ in range(_STARTS)]
    if np.all(real):
        return _along_frequency(system, candidates, frequency, random)
    found = [_turned(matrix, real, q) for q in candidates]
    value, q = max(found, key=lambda item: item[0])
    if np.any(real):
        value, q = _improved(matrix, real, value, q, random)
    return (value, frequency, q / value) if value > 0.0 else (0.0, frequency, np.zeros(0, dtype=np.complex128))


def _iterated(matrix: Complexes, real: NDArray[np.bool_], random: np.random.Generator) -> Complexes:
    """Power iteration for alignment of z = M w and its dual; returns Q."""
    n = len(matrix)
    b = random.normal(size=n) + 1j * random.normal(size=n)
    w = random.normal(size=n) + 1j * random.normal(size=n)
    b, w = b / np.linalg.norm(b), w / np.linalg.norm(w)
    q = np.where(real, np.sign(random.normal(size=n)), np.exp(2j * np.pi * random.uniform(size=n)))
    tiny = np.finfo(float).tiny
    for _ in range(_STEPS):
        a = matrix @ b
        a = a / (np.linalg.norm(a) + tiny)
        z = _new_z(q, w, a, real)
        w = matrix.conj().T @ z
        w = w / (np.linalg.norm(w) + tiny)
        q = _new_q(q, w, a, real)
        b = q * a
        b = b / (np.linalg.norm(b) + tiny)
    return q


def _new_z(q: Complexes, w: Complexes, a: Complexes, real: NDArray[np.bool_]) -> Complexes:
    size = np.abs(a) + np.finfo(float).tiny
    return np.where(real, q.real * w, np.abs(w) * a / size)


def _new_q(q: Complexes, w: Complexes, a: Complexes, real: NDArray[np.bool_]) -> Complexes:
    aligned = np.real(np.conj(a) * w)
    share = np.abs(a) / (np.abs(w) + np.finfo(float).tiny)
    moved = np.clip(np.sign(q.real) * share + aligned / (np.abs(w) ** 2 + np.finfo(float).tiny), -1.0, 1.0)
    moved = np.where(moved == 0.0, 1.0, moved)
    phase = w * np.conj(a)
    return np.where(real, moved, phase / (np.abs(phase) + np.finfo(float).tiny))


def _turned(matrix: Complexes, real: NDArray[np.bool_], q: Complexes) -> tuple[float, Complexes]:
    """The largest positive real eigenvalue of M Q over common turns of the complex entries of Q."""
    if not np.any(real):
        values = np.linalg.eigvals(matrix * q)
        best = values[np.argmax(np.abs(values))]
        return (float(abs(best)), q * np.exp(-1j * np.angle(best))) if abs(best) > 0.0 else (0.0, q)

    def turned(angle: float) -> Complexes:
        return np.asarray(np.where(real, q, q * np.exp(1j * angle)))

    angles = np.linspace(0.0, 2.0 * np.pi, _TURNS + 1)
    values = np.linalg.eigvals(matrix[np.newaxis] * np.array([turned(angle) for angle in angles])[:, np.newaxis, :])
    best, at = 0.0, q
    for step in range(_TURNS):
        for start in values[step]:
            follower = values[step + 1][np.argmin(np.abs(values[step + 1] - start))]
            if (start.real <= best and follower.real <= best) or start.imag * follower.imag > 0.0:
                continue
            solved = _real_eigenvalue(matrix, turned, angles[step], angles[step + 1], complex(start), complex(follower))
            if solved is not None and solved[0] > best:
                best, at = solved[0], turned(solved[1])
    return best, at


def _real_eigenvalue(matrix, turned, low, high, start, follower):  # type: ignore[no-untyped-def]
    """An angle between two at which the eigenvalue that leads from one value to another is real and positive."""

    def nearest(angle: float) -> complex:
        share = (angle - low) / (high - low)
        values = np.linalg.eigvals(matrix * turned(angle))
        return complex(values[np.argmin(np.abs(values - (1.0 - share) * start - share * follower))])

    if nearest(low).imag * nearest(high).imag > 0.0:
        return None
    angle = brentq(lambda at: nearest(at).imag, low, high, xtol=1e-15, rtol=1e-14)
    value = nearest(angle)
    return (value.real, angle) if value.real > 0.0 and abs(value.imag) < 1e-9 * value.real else None


def _improved(
    matrix: Complexes, real: NDArray[np.bool_], value: float, q: Complexes, random: np.random.Generator
) -> tuple[float, Complexes]:
    """Random search around a candidate, with steps that shrink, and signs of real entries exchanged."""
    for place in np.flatnonzero(real):
        trial = q.copy()
        trial[place] = -trial[place]
        value, q = max((value, q), _turned(matrix, real, trial), key=lambda item: item[0])
    for step in np.repeat([1.0, 0.3, 0.1, 0.03], 4):
        trial = np.where(
            real,
            np.clip(q.real + step * random.normal(size=len(q)), -1.0, 1.0),
            q * np.exp(1j * step * random.normal(size=len(q))),
        )
        value, q = max((value, q), _turned(matrix, real, trial), key=lambda item: item[0])
    return value, q


def _along_frequency(system: Lti, candidates: list[Complexes], frequency: float, random: np.random.Generator) -> Found:
    """The largest real eigenvalue of M Q for real Q, over frequencies about one."""
    half = 0.5 / system.sample_time
    grid = np.clip(frequency * np.linspace(1.0 - _SPAN, 1.0 + _SPAN, _POINTS), 0.0, half)
    responses = system.response(grid)
    n = len(system.c)
    corners = [np.sign(q.real) for q in candidates] + [np.ones(n), -np.ones(n)]
    corners += [random.choice([-1.0, 1.0], size=n) for _ in range(4 * n)]
    best: Found = (0.0, frequency, np.zeros(0, dtype=np.complex128))
    for q in {tuple(corner): corner for corner in corners}.values():
        best = max(best, _real_crossing(system, responses, grid, np.asarray(q)), key=lambda item: item[0])
    return best


def _real_crossing(system: Lti, responses: Complexes, grid: Arrays, q: Arrays) -> Found:
    values = np.linalg.eigvals(responses * q)
    best: Found = (0.0, float(grid[0]), np.zeros(0, dtype=np.complex128))
    for step in range(len(grid) - 1):
        for start in values[step]:
            follower = values[step + 1][np.argmin(np.abs(values[step + 1] - start))]
            if max(start.real, follower.real) <= best[0] or start.imag * follower.imag > 0.0:
                continue
            found = _crossing_between(system, grid[step], grid[step + 1], q, complex(start), complex(follower))
            if found is not None and found[0] > best[0]:
                best = found
    return best


def _crossing_between(system, low, high, q, start, follower):  # type: ignore[no-untyped-def]
    def nearest(at: float) -> complex:
        share = (at - low) / (high - low)
        values = np.linalg.eigvals(system.response(np.array([at]))[0] * q)
        return complex(values[np.argmin(np.abs(values - (1.0 - share) * start - share * follower))])

    ends = nearest(low), nearest(high)
    if ends[0].imag * ends[1].imag > 0.0 or high <= low:
        return None
    at = low if ends[0].imag == 0.0 else brentq(lambda one: nearest(one).imag, low, high, xtol=1e-12, rtol=1e-14)
    value = nearest(at)
    if value.real <= 0.0 or abs(value.imag) > 1e-8 * value.real:
        return None
    return value.real, float(at), (q / value.real).astype(np.complex128)
