"""Response to references by the local polynomial method: without bias by leakage and transients, any broad band.

At the line k of the discrete Fourier transforms of an experiment, Z(k) = G(k) R(k) + T(k) + V(k). T, which comes from
the state at both ends of the record, is as smooth over frequency as G. So in a narrow band about a frequency f_0 both
are polynomials of f - f_0, whose coefficients follow by least squares from all lines of all experiments in the band, T
of each experiment by itself. The residuals give the covariance of V, and with it that of G(f_0).

A swept sine needs this: it excites low and high frequencies at the ends of its record, where a window such as Hann's
takes the signal away and a record without one leaks.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, section
7.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import RobustnessError
from amb_core.linear import Arrays, Complexes

ORDER = 2  # of the polynomials
REDUNDANCY = 3.0  # lines in a band, at least, over unknowns
BAND = 0.004  # of the frequency, width of a band where it has enough lines
LEAST_INDEPENDENCE = 0.03
"""Of a column of the least squares from those before it, as a share of its length. A signal that acts only at the very
start or end of a record looks like a transient: there the response is left open instead of guessed."""
ASIDE = 1e-3  # of the strongest reference in a band: weaker experiments do not count there
LEAST_POWER = 1e-8  # of a reference in a band, relative to its largest


@dataclass(frozen=True, eq=False)
class LocalResponse:
    """Response of q signals to p references.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    response : ndarray of complex, shape (f, q, p)
        G.
    noise : ndarray of complex, shape (f, q, q)
        Covariance of V.
    spread : ndarray of complex, shape (f, p, p)
        E(dG_ij dG_kl*) = noise_ik spread_jl.
    coherence : ndarray, shape (f, q)
        Share of the power of each signal in the band that references and transients explain, 0 to 1.
    half_band : ndarray, shape (f,)
        Distance (Hz) of the farthest lines from which a value follows.
    """

    frequency: Arrays
    response: Complexes
    noise: Complexes
    spread: Complexes
    coherence: Arrays
    half_band: Arrays

    def joined(self, other: LocalResponse) -> LocalResponse:
        """With the values of another one, ascending in frequency."""
        order = np.argsort(np.concatenate([self.frequency, other.frequency]), kind="stable")
        parts = (np.concatenate([getattr(self, one.name), getattr(other, one.name)]) for one in fields(self))
        return LocalResponse(*(part[order] for part in parts))

    def at(self, kept: NDArray[np.bool_]) -> LocalResponse:
        """The values at some frequencies."""
        return LocalResponse(*(getattr(self, one.name)[kept] for one in fields(self)))


def local_response(
    experiments: Sequence[tuple[Arrays, Arrays]], sample_time: float, frequency: Arrays
) -> LocalResponse:
    """Response of signals to references near given frequencies; those that no band determines are left out.

    Parameters
    ----------
    experiments : sequence of (ndarray, ndarray)
        References, shape (steps, p), and signals, shape (steps, q), of each experiment.
    sample_time : float
        Sample time (s).
    frequency : ndarray, shape (f,)
        Wanted frequencies (Hz), ascending.

    Raises
    ------
    RobustnessError
        If the references determine the response at none of them.
    """
    spectra = [spectrum_of(*item, sample_time) for item in experiments]
    references, signals = experiments[0][0].shape[1], experiments[0][1].shape[1]
    largest = np.max([np.mean(np.abs(r) ** 2, axis=0) for _, r, _ in spectra], axis=0)
    solutions = []
    for at in frequency:
        excited = those_excited(spectra, at, 0.5 * BAND * at)
        unknowns = (ORDER + 1) * (references + len(excited))
        half = 0.5 * max(BAND * at, REDUNDANCY * unknowns * _spacing(excited))
        lines = [_band(item, at, half) for item in excited]
        power = np.mean(np.abs(np.vstack([r for _, r, _ in lines])) ** 2, axis=0)
        if at > half and np.all(power > LEAST_POWER * largest):
            solved = _solve(lines, at, half, signals)
            if solved is not None:
                solutions.append((at, *solved, half))
    if not solutions:
        raise RobustnessError(
            "the references determine the response at no frequency; excite each axis, one after the other"
        )
    return LocalResponse(*(np.array(item) for item in zip(*solutions, strict=True)))


Spectrum = tuple[Arrays, Complexes, Complexes]
"""Frequencies of the lines, references and signals there."""


def those_excited(spectra: Sequence[Spectrum], at: float, half: float) -> list[Spectrum]:
    """Experiments whose references act about a frequency; others would only add the unknowns of their transients."""
    powers = []
    for item in spectra:
        near = _band(item, at, max(half, 2.0 * item[0][1]))[1]
        powers.append(float(np.sum(np.abs(near) ** 2)) / max(len(near), 1))
    return [item for item, power in zip(spectra, powers, strict=True) if power >= ASIDE * max(powers)]


def _spacing(spectra: Sequence[Spectrum]) -> float:
    """Distance of the lines of all experiments together (Hz)."""
    return 1.0 / sum(1.0 / float(item[0][1]) for item in spectra)


def spectrum_of(references: Arrays, signals: Arrays, sample_time: float) -> Spectrum:
    """Lines of the discrete Fourier transforms of an experiment."""
    steps = len(references)
    both = (np.fft.rfft(item - item.mean(axis=0), axis=0) / np.sqrt(steps) for item in (references, signals))
    return np.fft.rfftfreq(steps, sample_time), *both


def _band(item: Spectrum, at: float, half: float) -> Spectrum:
    frequency = item[0]
    part = slice(*np.searchsorted(frequency, [at - half, at + half]))
    return frequency[part], item[1][part], item[2][part]


def _solve(
    lines: Sequence[Spectrum], at: float, half: float, signals: int
) -> tuple[Complexes, Complexes, Complexes, Arrays] | None:
    """Response, covariance of the noise, spread and coherence at a frequency; None if the band leaves them open."""
    rows = [
        (
            _polynomial((frequency - at) / half, references),
            _polynomial((frequency - at) / half, np.ones((len(z), 1))),
            z,
        )
        for frequency, references, z in lines
    ]
    total, columns = sum(len(z) for *_, z in rows), rows[0][0].shape[1]
    matrix = np.zeros((total, columns + (ORDER + 1) * len(rows)), dtype=complex)
    start = 0
    for number, (by_reference, transient, _) in enumerate(rows):
        stop = start + len(transient)
        matrix[start:stop, :columns] = by_reference
        place = columns + number * (ORDER + 1)
        matrix[start:stop, place : place + ORDER + 1] = transient
        start = stop
    wanted = np.vstack([z for *_, z in rows])
    size = np.linalg.norm(matrix, axis=0)
    free = total - matrix.shape[1]
    if free < signals or not np.all(size > 0.0):
        return None
    q, r = np.linalg.qr(matrix / size)
    if np.abs(np.diagonal(r)).min() < LEAST_INDEPENDENCE:
        return None
    inverse = np.linalg.inv(r) / size[:, np.newaxis]
    coefficients = inverse @ (q.conj().T @ wanted)
    left = wanted - q @ (q.conj().T @ wanted)
    noise = left.T @ left.conj() / free
    p = columns // (ORDER + 1)
    spread = (inverse @ inverse.conj().T)[:p, :p]
    power = np.sum(np.abs(wanted) ** 2, axis=0)
    coherence = 1.0 - np.diagonal(noise).real * total / np.maximum(power, np.finfo(float).tiny)
    return coefficients[:p].T, noise, spread, np.clip(coherence, 0.0, 1.0)


def _polynomial(place: Arrays, values: Complexes | Arrays) -> Complexes:
    """Columns values * place**0, then values * place**1 ..., shape (lines, (ORDER + 1) * columns)."""
    return np.hstack([values * place[:, np.newaxis] ** power for power in range(ORDER + 1)]).astype(np.complex128)
