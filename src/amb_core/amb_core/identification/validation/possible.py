"""The closed-loop fit that data allow, of which a linear loop follows the references: no model enters.

    y[k] = A_1 y[k-1] + ... + A_L y[k-L] + B_0 r[k] + ... + B_L r[k-L] + c + e[k]

The references contain no noise, so this regression describes the loop, feedback or not. Simulated from the references
alone it leaves what noise, disturbances and distortion move, as the simulation of a true model does. With few lags the
noise biases it, so that it leaves more; of several numbers of lags the one counts that leaves least. A judged model
that is poor, or comes from few samples, cannot lower this fit.

At high sample rates as many lags are a shorter time, and the noise biases them more. Above 10 kHz the lags are also
taken 2, 4, 8 ... samples apart, as long as they are not further apart than samples of 10 kHz, with the references
averaged over as many samples.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 4.2 and 13.5 (indirect identification).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.ground.sample_times import SAME
from amb_core.linear.numerics import with_rows
from amb_core.loop.records import LoopRecord

Arrays = NDArray[np.float64]

LAGS = (6, 12, 25, 50)
"""Numbers of lags that are tried."""
SLOWEST = 10_000.0
"""Rate (Hz) down to which lags are taken several samples apart."""
_ROWS_PER_COLUMN = 3
_MOST_ROWS = 20_000  # those of longer data are thinned out
_BLOCK = 2_000  # rows of the regression held at once
_RANK = 1e-9  # singular value relative to the largest, below which it is rounding
_FARTHEST = 1e6  # of a simulated position, relative to the motion: it diverges


@dataclass(frozen=True, eq=False)
class PossibleFit:
    """The closed-loop fit that a true model reaches on these data.

    Attributes
    ----------
    fit, deviation : ndarray, shape (axes,)
        Expected fit and its standard deviation by the noise (percent).
    """

    fit: Arrays
    deviation: Arrays

    def chance(self, probability: float) -> Arrays:
        """What a true model loses more only with a probability (points), shape (axes,)."""
        return -float(special.ndtri(probability)) * self.deviation


def possible_fit(measured: Sequence[LoopRecord]) -> PossibleFit | None:
    """Fit of the regression with the most suitable number of lags, each axis.

    Parameters
    ----------
    measured : sequence of LoopRecord
        The experiments whose reference is known.

    Returns
    -------
    PossibleFit or None
        None for too few samples, or where a position does not move.
    """
    positions = np.vstack([record.position for record in measured])
    motion = positions.std(axis=0)
    if not np.all(motion > 0.0):
        return None
    outputs = [(record.position - positions.mean(axis=0)) / motion for record in measured]
    references = _scaled([record.reference for record in measured])
    best: tuple[Arrays, Arrays] | None = None
    axes, columns = len(motion), len(motion) + references[0].shape[1]
    for apart in _distances(measured[0].sample_time):
        allowed = [lags for lags in LAGS if _rows(outputs, lags * apart) >= _ROWS_PER_COLUMN * columns * (lags + 1)]
        if not allowed:
            break
        driving = [_averaged(reference, apart) for reference in references]
        triangle = _triangle(outputs, driving, allowed[-1], apart)
        for lags in allowed:
            used = 1 + references[0].shape[1] + columns * lags
            values = np.asarray(np.linalg.lstsq(triangle[:used, :used], triangle[:used, -axes:], rcond=_RANK)[0])
            rest = _rest(values, outputs, driving, lags, apart)
            if rest is None:
                continue
            mean_square, deviation = _size(rest, references[0].shape[1] * (lags + 1))
            if best is None:
                best = mean_square, deviation
            else:
                less = mean_square < best[0]
                best = np.where(less, mean_square, best[0]), np.where(less, deviation, best[1])
    if best is None:
        return None
    rms = np.sqrt(best[0])
    return PossibleFit(100.0 * (1.0 - rms), 50.0 * best[1] / np.maximum(rms, np.finfo(float).tiny))


def _scaled(references: list[Arrays]) -> list[Arrays]:
    """References in units of their root mean square; one that does not move stays."""
    size = np.sqrt(np.mean(np.vstack(references) ** 2, axis=0))
    return [reference / np.where(size > 0.0, size, 1.0) for reference in references]


def _distances(sample_time: float) -> Iterator[int]:
    """Samples from one lag to the next: 1, and doubled as long as lags are no further apart than those of 10 kHz."""
    apart = 1
    while apart == 1 or SLOWEST * apart * sample_time <= 1.0 + SAME:
        yield apart
        apart *= 2


def _averaged(reference: Arrays, samples: int) -> Arrays:
    """The mean of each sample and those before it, so many in all."""
    if samples == 1:
        return reference
    total = np.cumsum(np.vstack([np.repeat(reference[:1], samples, axis=0), reference]), axis=0)
    return np.asarray((total[samples:] - total[:-samples]) / samples)


def _rows(outputs: Sequence[Arrays], first: int) -> int:
    return sum(max(len(part) - first, 0) for part in outputs)


def _triangle(outputs: Sequence[Arrays], references: Sequence[Arrays], lags: int, apart: int) -> Arrays:
    """Triangular factor of the rows (1, r[k], y[k-1], r[k-1], y[k-2], ..., y[k]): fewer lags are its first columns."""
    columns = 1 + references[0].shape[1] + (references[0].shape[1] + outputs[0].shape[1]) * lags + outputs[0].shape[1]
    triangle = np.zeros((columns, columns))
    every = -(-_rows(outputs, lags * apart) // _MOST_ROWS)
    for y, r in zip(outputs, references, strict=True):
        present = np.arange(lags * apart, len(y), every)
        for first in range(0, len(present), _BLOCK):
            at = present[first : first + _BLOCK]
            past = [np.hstack([y[at - lag * apart], r[at - lag * apart]]) for lag in range(1, lags + 1)]
            triangle = with_rows(triangle, np.hstack([np.ones((len(at), 1)), r[at], *past, y[at]]))
    return triangle


def _rest(
    values: Arrays, outputs: Sequence[Arrays], references: Sequence[Arrays], lags: int, apart: int
) -> list[Arrays] | None:
    """What the regression, simulated from the references, leaves of the outputs; None where it diverges."""
    p, m = outputs[0].shape[1], references[0].shape[1]
    of_lags = values[1 + m :].reshape(lags, p + m, p)
    by_outputs = np.ascontiguousarray(of_lags[:, :p])
    rest = []
    for y, r in zip(outputs, references, strict=True):
        first = lags * apart
        if len(y) <= first:
            continue
        drive = values[0] + r[first:] @ values[1 : 1 + m]
        for lag in range(1, lags + 1):
            drive += r[first - lag * apart : len(r) - lag * apart] @ of_lags[lag - 1, p:]
        simulated = np.empty_like(y)
        simulated[:first] = y[:first]
        _simulate(by_outputs, drive, simulated, apart)
        if not np.abs(simulated).max() < _FARTHEST:  # not a number is none either
            return None
        rest.append((y - simulated)[first:])
    return rest


def _size(rest: Sequence[Arrays], parameters: int) -> tuple[Arrays, Arrays]:
    """Mean square of the rest without its share that the parameters took, and its standard deviation by chance."""
    together = np.vstack(rest)
    count = len(together)
    power = np.abs(np.fft.fft(together, axis=0)) ** 2 / count
    # The mean square of normal noise varies by 2 / N times the mean square of its spectrum; that of a periodogram is
    # twice as large.
    mean_square = np.mean(together**2, axis=0) * count / (count - parameters)
    return mean_square, np.sqrt(np.mean(power**2, axis=0) / count)


@numba.njit(cache=True)
def _simulate(by_outputs: NDArray[np.float64], drive: Arrays, outputs: Arrays, apart: int) -> None:
    """Fill in the outputs from the first samples onwards, which they hold."""
    lags, p = by_outputs.shape[0], by_outputs.shape[1]
    first = lags * apart
    for step in range(first, len(outputs)):
        for to in range(p):
            value = drive[step - first, to]
            for lag in range(lags):
                for source in range(p):
                    value += by_outputs[lag, source, to] * outputs[step - (1 + lag) * apart, source]
            outputs[step, to] = value
