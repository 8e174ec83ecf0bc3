"""Modes that a model lacks, fitted to the lines of simulation errors; see `error_band` for the equations.

Each fit takes the lines about one frequency. There are thousands of them for a certificate, so what runs over lines is
compiled, and what runs over fits is done for all of them at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.linear import Arrays, Complexes

Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
_Arrays = tuple[Arrays, Arrays, Complexes, Complexes, Complexes]
_Work = tuple[Complexes, Complexes, Complexes, Complexes]

CONFIDENCE = 0.999  # at each frequency
_REACH = 8.0  # half bandwidths of a mode to either side, from which lines are taken
_FEWEST = 4.0  # free terms for each reference
_LEAST_INDEPENDENCE = 1e-5
_NEAR = 0.25  # of the power that drives a mode, within its half bandwidth: half of it if all is excited alike
_LEAST_KEPT = 0.1  # of that power without what looks like a transient; the ends of a record do


@dataclass(frozen=True, eq=False)
class Spectra:
    """Lines of an experiment.

    Attributes
    ----------
    frequency : ndarray, shape (l,)
        Frequencies (Hz), rising.
    r : ndarray of complex, shape (l, p)
        References.
    u : ndarray of complex, shape (l, m)
        Inputs.
    d : ndarray of complex, shape (l, p)
        Simulation errors.
    """

    frequency: Arrays
    r: Complexes
    u: Complexes
    d: Complexes

    @cached_property
    def power(self) -> Arrays:
        """Of all references at each line; shape (l,)."""
        return np.asarray(np.sum(np.abs(self.r) ** 2, axis=1))


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of all experiments, one after the other, as the compiled functions take them.

    Attributes
    ----------
    arrays : tuple of ndarray
        Frequency, power of the references, references, inputs and simulation errors.
    starts : ndarray of int, shape (k + 1,)
        Where each experiment begins, and where the last one ends.
    sets : ndarray of bool, shape (s, k)
        The experiments that are fitted together: first all, then those of each record, if there are several.
    least : float
        Power of the references above which a line counts.
    """

    arrays: _Arrays
    starts: Integers
    sets: Flags
    least: float


def lines_of(records: Sequence[Sequence[Spectra]], least: float) -> Lines:
    """The lines of the experiments of records.

    Parameters
    ----------
    records : sequence of sequence of Spectra
        The experiments of each record, at least one.
    least : float
        Power of the references above which a line counts.
    """
    experiments = [item for one in records for item in one]
    of_record = np.repeat(np.arange(len(records)), [len(one) for one in records])
    alone = [of_record == number for number in range(len(records))] if len(records) > 1 else []
    frequency, power, r, u, d = (
        np.concatenate([getattr(item, name) for item in experiments]) for name in ("frequency", "power", "r", "u", "d")
    )
    starts = np.cumsum([0, *(len(item.frequency) for item in experiments)])
    return Lines((frequency, power, r, u, d), starts, np.array([np.ones(len(of_record), dtype=bool), *alone]), least)


def fit_modes(lines: Lines, at: Arrays, damping: float, weight: Complexes) -> tuple[Arrays, Arrays]:
    """Error of the response at the peak of modes, weighted, and what the data leave open beside it.

    All records together determine it best if they are of one bearing. One that contradicts this counts alone.

    Parameters
    ----------
    lines : Lines
        What the data show.
    at : ndarray, shape (n,)
        Frequencies of the modes (Hz).
    damping : float
        Damping ratio of all of them.
    weight : ndarray of complex, shape (n, m, c)
        Errors are multiplied by it from the right.

    Returns
    -------
    size, open : ndarray, shape (n,)
        Largest singular value of the weighted error, and its confidence, in the same unit: 0 and infinite where the
        lines do not determine it.
    """
    halves = damping * at
    error, open_ = _errors(lines, at, halves, weight)
    size = np.linalg.norm(error, 2, axis=(2, 3))
    known = np.isfinite(open_)
    apart = np.linalg.norm(error - error[:, :1], 2, axis=(2, 3))
    counts = known & (apart > np.where(known, open_, 0.0))
    counts[:, 0] = known[:, 0]
    largest = np.argmax(np.where(counts, size + np.where(known, open_, 0.0), -np.inf), axis=1)
    places = np.arange(len(at))
    determined = known[:, 0]
    return np.where(determined, size[places, largest], 0.0), np.where(determined, open_[places, largest], np.inf)


def _errors(lines: Lines, at: Arrays, halves: Arrays, weight: Complexes) -> tuple[Complexes, Arrays]:
    """Weighted errors by instrumental variables, shape (n, s, p, c), and what is open; infinite where not determined.

    The errors are 0 there.
    """
    rr, ur, yr, counted = _products(lines.arrays, lines.starts, lines.sets, at, halves, lines.least)
    references = rr.shape[-1]
    free = counted - references - 1.0
    scale = np.sqrt(np.diagonal(rr, axis1=2, axis2=3).real)
    determined = (free >= _FEWEST * references) & np.all(scale > 0.0, axis=2)
    scale = np.where(determined[..., np.newaxis], scale, 1.0)
    independent = np.linalg.eigvalsh(rr / (scale[..., :, np.newaxis] * scale[..., np.newaxis, :]))[..., 0]
    largest = np.abs(ur).max(axis=(2, 3))
    determined &= (independent >= _LEAST_INDEPENDENCE) & (largest > 0.0)
    relative = ur / np.where(determined, largest, 1.0)[..., np.newaxis, np.newaxis]
    determined &= np.linalg.det(relative) != 0.0
    invertible = np.where(determined[..., np.newaxis, np.newaxis], ur, np.eye(references))
    inverse = np.asarray(np.linalg.inv(invertible), dtype=np.complex128)
    error = np.asarray(np.where(determined[..., np.newaxis, np.newaxis], yr @ inverse, 0.0), dtype=np.complex128)
    weighted = np.ascontiguousarray(inverse @ weight[:, np.newaxis])
    scatter = _scatter(lines.arrays, lines.starts, lines.sets, at, halves, lines.least, error, weighted)
    free = np.where(determined, free, 1.0)
    error = error @ weight[:, np.newaxis]
    count = error.shape[2] * error.shape[3]
    quantile = special.fdtri(2 * count, 2.0 * free, CONFIDENCE)
    return error, np.where(determined, np.sqrt(quantile * scatter * counted / free), math.inf)


@numba.njit(cache=True)
def _products(
    arrays: _Arrays, starts: Integers, sets: Flags, at: Arrays, halves: Arrays, least: float
) -> tuple[Complexes, Complexes, Complexes, Arrays]:
    """Products of references, inputs and errors with the references, summed over the lines of each set; how many count.

    Shapes (n, s, p, p), (n, s, m, p), (n, s, p, p) and (n, s).
    """
    _, _, r, u, d = arrays
    work = _work(arrays, starts)
    _, z, x, y = work
    rr = np.zeros((len(at), len(sets), r.shape[1], r.shape[1]), np.complex128)
    ur = np.zeros((len(at), len(sets), u.shape[1], r.shape[1]), np.complex128)
    yr = np.zeros((len(at), len(sets), d.shape[1], r.shape[1]), np.complex128)
    counted = np.zeros((len(at), len(sets)))
    for place in range(len(at)):
        for part in range(len(starts) - 1):
            lines, effective = _near(arrays, starts[part : part + 2], at[place], halves[place], least, work)
            if lines == 0:
                continue
            for chosen in range(len(sets)):
                if not sets[chosen, part]:
                    continue
                counted[place, chosen] += effective
                _add_product(z, z, lines, rr[place, chosen])
                _add_product(x, z, lines, ur[place, chosen])
                _add_product(y, z, lines, yr[place, chosen])
    return rr, ur, yr, counted


@numba.njit(cache=True)
def _add_product(values: Complexes, references: Complexes, lines: int, total: Complexes) -> None:
    """Add values^T conj(references) over the lines."""
    for line in range(lines):
        for column in range(references.shape[1]):
            reference = np.conj(references[line, column])
            for row in range(values.shape[1]):
                total[row, column] += values[line, row] * reference


@numba.njit(cache=True)
def _scatter(
    arrays: _Arrays, starts: Integers, sets: Flags, at: Arrays, halves: Arrays, least: float,
    error: Complexes, weighted: Complexes,
) -> Arrays:  # fmt: skip
    """What the errors leave of each line, squared, times the square of its share in what is weighted; shape (n, s)."""
    _, _, r, u, d = arrays
    work = _work(arrays, starts)
    _, z, x, y = work
    scatter = np.zeros((len(at), len(sets)))
    for place in range(len(at)):
        for part in range(len(starts) - 1):
            lines, _ = _near(arrays, starts[part : part + 2], at[place], halves[place], least, work)
            for chosen in range(len(sets)):
                if not sets[chosen, part]:
                    continue
                for line in range(lines):
                    rest = 0.0
                    for row in range(d.shape[1]):
                        left = y[line, row]
                        for column in range(u.shape[1]):
                            left -= error[place, chosen, row, column] * x[line, column]
                        rest += left.real**2 + left.imag**2
                    gain = 0.0
                    for column in range(weighted.shape[3]):
                        share = 0.0j
                        for row in range(r.shape[1]):
                            share += np.conj(z[line, row]) * weighted[place, chosen, row, column]
                        gain += share.real**2 + share.imag**2
                    scatter[place, chosen] += rest * gain
    return scatter


@numba.njit(cache=True)
def _work(arrays: _Arrays, starts: Integers) -> _Work:
    """Shape of a mode, references, inputs and errors, each as long as the longest experiment."""
    _, _, r, u, d = arrays
    lines = np.max(starts[1:] - starts[:-1])
    return (
        np.empty(lines, np.complex128),
        np.empty((lines, r.shape[1]), np.complex128),
        np.empty((lines, u.shape[1]), np.complex128),
        np.empty((lines, d.shape[1]), np.complex128),
    )


@numba.njit(cache=True)
def _near(arrays: _Arrays, ends: Integers, at: float, half: float, least: float, work: _Work) -> tuple[int, float]:
    """Fill the arrays of work with the lines of an experiment that show a mode.

    The shape of the mode is applied to references and inputs, and its transient removed. Returns their number, and how
    many count; 0 if they do not show it.
    """
    frequency, power, r, u, d = arrays
    shape, z, x, y = work
    start, end = ends
    own = frequency[start:end]
    low = start + np.searchsorted(own, at - _REACH * half)
    high = start + np.searchsorted(own, at + _REACH * half)
    lines = high - low
    if lines < 3:
        return 0, 0.0
    moves, shape_power, weights, squares, near = False, 0.0, 0.0, 0.0, 0.0
    for line in range(lines):
        line_power = power[low + line]
        moves |= line_power > least
        offset = (frequency[low + line] - at) / half
        squared = 1.0 / (1.0 + offset * offset)
        shape[line] = complex(squared, -offset * squared)
        weight = squared * line_power
        shape_power += squared
        weights += weight
        squares += weight * weight
        if abs(offset) <= 1.0:
            near += weight
    if not moves or near < _NEAR * weights:
        return 0, 0.0
    kept = _cleared(r[low:high], shape, shape_power, True, z)
    if kept < _LEAST_KEPT * weights:
        return 0, 0.0
    _cleared(u[low:high], shape, shape_power, True, x)
    _cleared(d[low:high], shape, shape_power, False, y)
    return lines, weights * weights / squares


@numba.njit(cache=True)
def _cleared(values: Complexes, shape: Complexes, shape_power: float, shaped: bool, out: Complexes) -> float:
    """Values at lines, times the shape of a mode or as they are, without what looks like its transient; their power."""
    power = 0.0
    for column in range(values.shape[1]):
        alike = 0.0j
        for line in range(len(values)):
            value = values[line, column] * shape[line] if shaped else values[line, column]
            out[line, column] = value
            alike += np.conj(shape[line]) * value
        alike /= shape_power
        for line in range(len(values)):
            left = out[line, column] - shape[line] * alike
            out[line, column] = left
            power += left.real**2 + left.imag**2
    return power
