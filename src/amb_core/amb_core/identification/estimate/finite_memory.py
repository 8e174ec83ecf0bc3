"""The data for predictors of finite memory: a small matrix that makes fits very cheap.

A predictor that looks P steps back is a linear combination of z[k-1] ... z[k-P], z = (u, y), and with direct
feedthrough of u[k]. Its squared errors need only the inner products of these and of y[k]. Shifted by one step, the
products are the same except for the samples at both ends. So their matrix costs little more than its first block row,
for any length of the memory. Its triangular factor replaces the data; predictors of longer memory are truncated.

A little noise, 130 dB below the signals, is added on the diagonal: it keeps the matrix definite where simulated data
contain no noise.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.estimate.filter_bank import Fit, Modes, best_gains, filtered, gain_sensitivity
from amb_core.identification.estimate.predictor import experiments
from amb_core.identification.estimate.scaled_data import ScaledData
from amb_core.linear.numerics import with_rows

_MEMORY = 200  # steps; longer ones cost time
_MOST_COLUMNS = 2_000  # steps times signals: time grows with their cube, memory with their square, 32 MB a matrix
_ADDED_NOISE = 1e-13  # variance, relative to the signals'
_SEGMENT = 4_000  # steps that go alternately to the two halves of the data


@dataclass(frozen=True)
class FiniteMemory:
    """Triangular factor of the rows [z[k-1] ... z[k-P]  y[k]], with u[k] before y[k] for direct feedthrough.

    It is divided by the root of their number.

    Attributes
    ----------
    lagged : ndarray, shape (rows, m + p, P)
        Its columns for the past inputs and outputs.
    direct : ndarray, shape (rows, m) or (rows, 0)
        Its columns for the inputs of the same step; none without feedthrough.
    outputs : ndarray, shape (rows, p)
        Its columns for the outputs.
    steps : int
        Number of steps k that it stands for.
    """

    lagged: NDArray[np.float64]
    direct: NDArray[np.float64]
    outputs: NDArray[np.float64]
    steps: int

    @classmethod
    def of(cls, products: NDArray[np.float64], steps: int, outputs: int, feedthrough: bool = False) -> FiniteMemory:
        """From sums over `steps` steps, shape (P + 1, q, P + 1, q), of products of z[k] ... z[k-P].

        Raises
        ------
        LinAlgError
            If the products are not those of finite samples.
        """
        memory, q = len(products) - 1, products.shape[1]
        # Without feedthrough the inputs of step k are unknown to a predictor.
        present = np.arange(q if feedthrough else outputs) + (0 if feedthrough else q - outputs)
        kept = np.concatenate([np.arange(q, q * (memory + 1)), present])
        matrix = products.reshape(q * (memory + 1), -1)[np.ix_(kept, kept)] / steps
        factor = linalg.cholesky(matrix + _ADDED_NOISE * np.eye(len(matrix)), check_finite=True)
        past, direct = np.split(factor[:, :-outputs], [memory * q], axis=1)
        lagged = past.reshape(len(factor), memory, q).transpose(0, 2, 1)
        return cls(np.ascontiguousarray(lagged), direct, factor[:, -outputs:], steps)

    @classmethod
    def whole(cls, data: ScaledData, feedthrough: bool) -> FiniteMemory:
        """From all samples, see `of`.

        Raises
        ------
        LinAlgError
            If there are too few.
        """
        first, second, first_steps, second_steps = halves(data, memory_of(data))
        if not first_steps + second_steps:
            raise linalg.LinAlgError(f"{data.lengths} samples are too few for a memory of {memory_of(data)}")
        return cls.of(first + second, first_steps + second_steps, data.outputs.shape[1], feedthrough)

    def best(self, modes: Modes, weight: NDArray[np.float64]) -> Fit:
        """The best predictor with given modes, as `fit_gains` finds it from all samples."""
        rows = np.hstack([self._signals(modes).reshape(len(self.lagged), -1), self.direct, self.outputs])
        columns = rows.shape[1]
        factor = with_rows(np.asarray(np.linalg.qr(rows[:columns], mode="r")), rows[columns:])
        return best_gains(modes, factor, weight, self.direct.shape[1])

    def error_covariance(self, fit: Fit) -> NDArray[np.float64]:
        """Covariance of the one-step prediction errors of a fit to any data, shape (p, p)."""
        p = self.outputs.shape[1]
        regressors = gain_sensitivity(fit.modes, self._signals(fit.modes), np.eye(p))
        errors = self.outputs.T - (regressors @ fit.gains.reshape(-1)).reshape(p, -1)
        if fit.feedthrough.size:
            errors = errors - fit.feedthrough @ self.direct.T
        return np.asarray(errors @ errors.T)

    def _signals(self, modes: Modes) -> NDArray[np.float64]:
        """The signals of the filter bank in the coordinates of the rows, shape (rows, signals, q)."""
        rows, q, memory = self.lagged.shape
        impulse = np.zeros((memory + 1, 1))
        impulse[0] = 1.0
        answers = filtered(modes, impulse)[1:].reshape(memory, -1)
        signals = self.lagged.reshape(rows * q, memory) @ answers
        return signals.reshape(rows, q, -1).transpose(0, 2, 1)


def memory_of(data: ScaledData) -> int:
    """Steps that a predictor of these data looks back."""
    return memory_steps(max(data.lengths), data.inputs.shape[1] + data.outputs.shape[1])


def memory_steps(longest: int, signals: int) -> int:
    """Steps of memory for data whose longest experiment has `longest` steps, of that many inputs and outputs."""
    return max(1, min(_MEMORY, longest // 4, _MOST_COLUMNS // signals))


def halves(data: ScaledData, memory: int) -> tuple[NDArray[np.float64], NDArray[np.float64], int, int]:
    """Sums of products, as `FiniteMemory.of` takes them, over two halves of the data, and the steps of each.

    Segments go alternately to the halves, so both contain every phase of an experiment.
    """
    z = np.hstack([data.inputs, data.outputs])
    q = z.shape[1]
    sums, steps = np.zeros((2, memory + 1, q, memory + 1, q)), [0, 0]
    turn = 0
    for part in experiments(len(z), data.lengths):
        usable = part.stop - part.start - memory
        segments = max(2, math.ceil(usable / _SEGMENT)) if usable > 0 else 0
        edges = np.linspace(part.start + memory, part.stop, segments + 1).astype(int)
        for start, stop in itertools.pairwise(edges.tolist()):
            sums[turn] += _products(z, start, stop, memory)
            steps[turn] += stop - start
            turn = 1 - turn
    return sums[0], sums[1], steps[0], steps[1]


def _products(z: NDArray[np.float64], start: int, stop: int, memory: int) -> NDArray[np.float64]:
    """Sums of the products of z[k], z[k-1] ... z[k-memory] over the steps from `start` to before `stop`."""
    q = z.shape[1]
    products = np.empty((memory + 1, q, memory + 1, q))
    for lag in range(memory + 1):
        products[0, :, lag] = z[start:stop].T @ z[start - lag : stop - lag]
        products[lag, :, 0] = products[0, :, lag].T
    entering = z[start - 1 : start - memory - 1 : -1] if start > memory else z[start - 1 :: -1]
    leaving = z[stop - 1 : stop - memory - 1 : -1] if stop > memory else z[stop - 1 :: -1]
    for lag in range(memory):
        products[lag + 1, :, 1:] = (
            products[lag, :, :-1]
            + np.multiply.outer(z[start - 1 - lag], entering)
            - np.multiply.outer(z[stop - 1 - lag], leaving)
        )
    return products
