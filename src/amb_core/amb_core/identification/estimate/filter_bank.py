"""The predictor as a bank of second-order filters, and the factor of their signals for all least-squares problems.

In modal coordinates the predictor's matrix F = A - K C is block-diagonal, with blocks M of size 2 and columns C_M of C.
With t = tr M and d = det M the contribution of a block to the prediction is

    C_M (z I - M)^-1 G w = C_M (z I - (t I - M)) G v,    v = w / (z^2 - t z + d),

where w holds inputs and outputs, G the block's rows of (B, K). The derivatives by the entries of M are sums of v, z v
and, filtered once more, s = v / (z^2 - t z + d), z s. So four signals per block and channel replace the data, for any
number of parameters. Between blocks M and N with about equal modes, whose coordinates may turn rapidly, F is moved off
its diagonal too: one more signal r = v / (z^2 - t_N z + d_N), and z r, for each such pair. The first state of each
experiment enters as one more channel, an impulse before its first sample. A constant in each output is estimated along:
means of data that do not end as they began are not an equilibrium of the plant, and their error would pass for
dynamics. Direct feedthrough adds D u; B then stands for B - K D. An odd order is padded with a state that is neither
controllable nor observable.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 10.3 (gradients by filtering).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.estimate.predictor import experiments
from amb_core.linear.numerics import thin_svd, with_rows

_BLOCK = 1_000  # samples whose signals are held at once
_SMALLEST_SINGULAR_VALUE = 1e-12  # of the regressors, relative to the largest
_ALIKE = 0.1  # difference of the denominators of two blocks, relative to them, below which a step moves F between them
_LEAST_OBSERVABLE = 1e-12  # eigenvalue of a block's Gramian, relative to the other


@dataclass(frozen=True)
class Modes:
    """F and C in block-diagonal coordinates.

    Attributes
    ----------
    m : ndarray, shape (blocks, 2, 2)
        Diagonal blocks of F.
    c : ndarray, shape (blocks, p, 2)
        Their columns of C.
    order : int
        States without padding; those of the last block may be one more.
    """

    m: NDArray[np.float64]
    c: NDArray[np.float64]
    order: int

    @classmethod
    def of(cls, f: NDArray[np.float64], c: NDArray[np.float64]) -> Modes:
        """Block-diagonal form with output-normal blocks, of F with independent pairs of modes.

        A block has a pair of complex modes or two neighbouring real ones, which may become complex or change places.
        Its observability Gramian is a multiple of I: in an orthonormal basis instead, a pair of about equal modes may
        have off-diagonal entries near zero, whose products move its determinant, and searches stall.

        Raises
        ------
        LinAlgError
            If pairs of modes are not independent, as those of a multiple eigenvalue may be.
        """
        n = len(f)
        values, vectors = np.linalg.eig(f)
        reals = np.flatnonzero(values.imag == 0.0)
        reals = reals[np.argsort(-values[reals].real, kind="stable")]
        bases = [np.column_stack([vectors[:, i].real, vectors[:, i].imag]) for i in np.flatnonzero(values.imag > 0.0)]
        bases += [vectors[:, reals[i : i + 2]].real for i in range(0, len(reals), 2)]
        basis = np.hstack([np.linalg.qr(columns)[0] for columns in bases])
        f, c = np.linalg.solve(basis, f @ basis), c @ basis
        blocks = (n + 1) // 2
        f, c = np.pad(f, (0, 2 * blocks - n)), np.pad(c, ((0, 0), (0, 2 * blocks - n)))
        pairs = [_output_normal(f[i : i + 2, i : i + 2], c[:, i : i + 2]) for i in range(0, n, 2)]
        m, c = np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])
        return cls(m, c / np.maximum(np.linalg.norm(c, axis=(1, 2), keepdims=True), np.finfo(float).tiny), n)

    @property
    def trace(self) -> NDArray[np.float64]:
        """The trace t of each block."""
        return np.asarray(np.trace(self.m, axis1=1, axis2=2))

    @property
    def determinant(self) -> NDArray[np.float64]:
        """The determinant d of each block."""
        return np.asarray(np.linalg.det(self.m))

    @property
    def adjoint(self) -> NDArray[np.float64]:
        """The matrices t I - M, shape (blocks, 2, 2)."""
        return self.trace[:, np.newaxis, np.newaxis] * np.eye(2) - self.m

    @property
    def radius(self) -> float:
        """Largest magnitude of an eigenvalue of F."""
        return float(np.max(np.abs(np.linalg.eigvals(self.m))))

    def matrices(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """F and C without padding."""
        n = self.order
        return linalg.block_diag(*self.m)[:n, :n], np.hstack(list(self.c))[:, :n]

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of blocks with about equal modes."""
        return [pair for pair in itertools.combinations(range(self.order // 2), 2) if self._alike(*pair)]

    @cached_property
    def places(self) -> list[tuple[int, int]]:
        """Blocks of F, as row and column, in which a step moves it."""
        own = [(block, block) for block in range(len(self.m))]
        return own + [place for one, other in self.pairs for place in ((one, other), (other, one))]

    def _alike(self, one: int, other: int) -> bool:
        """Whether the denominators of two blocks are about the same at the frequencies of their modes."""
        pair = [one, other]
        z = np.exp(1j * np.angle(np.linalg.eigvals(self.m[pair]).ravel()))
        first, second = z**2 - self.trace[pair, np.newaxis] * z + self.determinant[pair, np.newaxis]
        return bool(np.all(np.abs(first - second) < _ALIKE * np.minimum(np.abs(first), np.abs(second))))

    def moved(self, step: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """F and C after a step in the coordinates of `Fit.sensitivity`."""
        f, c = linalg.block_diag(*self.m), np.hstack(list(self.c))
        split = 4 * len(self.places)
        for (i, j), change in zip(self.places, step[:split].reshape(-1, 2, 2), strict=True):
            f[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] += change
        c = c + np.hstack(list(step[split:].reshape(self.c.shape)))
        return f[: self.order, : self.order], c[:, : self.order]


def _output_normal(m: NDArray[np.float64], c: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A stable block where its observability Gramian is I; unchanged if a state is seen in no output."""
    gramian = np.linalg.solve(np.eye(4) - np.kron(m.T, m.T), (c.T @ c).ravel()).reshape(2, 2)
    least, largest = np.linalg.eigvalsh(gramian)
    if not least > _LEAST_OBSERVABLE * largest:
        return m, c
    root = np.linalg.cholesky(gramian).T
    return root @ m @ np.linalg.inv(root), c @ np.linalg.inv(root)


@dataclass(frozen=True)
class Fit:
    """The best predictor with given modes.

    Attributes
    ----------
    modes : Modes
        F and C.
    gains : ndarray, shape (blocks, 2, channels)
        Effect of inputs, outputs and the impulse before each experiment on the states: B, K, every x[0].
    covariance : ndarray, shape (p, p)
        Mean products of the one-step prediction errors.
    errors : ndarray, shape (p * rows,)
        Weighted errors, one output after the other, in the coordinates of the factor.
    sensitivity : ndarray, shape (p * rows, parameters)
        Derivatives of the weighted predictions by the entries of the blocks of F that `modes.places` names, then by
        those of `modes.c`, with the gains adapted.
    feedthrough : ndarray, shape (p, m) or (p, 0)
        D; without columns if there is no direct feedthrough.
    """

    modes: Modes
    gains: NDArray[np.float64]
    covariance: NDArray[np.float64]
    errors: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    feedthrough: NDArray[np.float64]

    def matrices(self, inputs: int) -> tuple[NDArray[np.float64], ...]:
        """A, B, C, K of a model with that many inputs, and x[0] of each experiment, shape (experiments, n)."""
        f, c = self.modes.matrices()
        gains = np.vstack(list(self.gains))[: self.modes.order]
        b, k, initial_states = np.split(gains, [inputs, inputs + len(c)], axis=1)
        if self.feedthrough.size:
            b = b + k @ self.feedthrough
        return f + k @ c, b, c, k, initial_states.T


def fit_gains(
    modes: Modes,
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    weight: NDArray[np.float64],
    lengths: Sequence[int] | None = None,
    feedthrough: bool = False,
) -> Fit:
    """Least-squares gains for given modes (variable projection), with errors and sensitivities.

    Parameters
    ----------
    modes : Modes
        Stable predictor modes.
    inputs, outputs : ndarray, shapes (steps, m), (steps, p)
        Data without offsets, each column scaled to the order of 1.
    weight : ndarray, shape (p, p)
        Errors are weighted as weight @ error; the sum of squares is taken.
    lengths : sequence of int, optional
        Steps of each experiment; one experiment by default.
    feedthrough : bool
        Whether outputs respond within the sample.
    """
    direct = inputs if feedthrough else inputs[:, :0]
    factor = _factor(modes, inputs, direct, outputs, experiments(len(inputs), lengths))
    return best_gains(modes, factor, weight, direct.shape[1])


def best_gains(modes: Modes, factor: NDArray[np.float64], weight: NDArray[np.float64], direct: int = 0) -> Fit:
    """As `fit_gains`, from a factor of the filters' signals (signal, channel), direct inputs and outputs."""
    p, blocks = len(weight), len(modes.m)
    filtered_columns = factor.shape[1] - p - direct
    signals = factor[:, :filtered_columns].reshape(len(factor), _signals(modes), -1)
    regressors = gain_sensitivity(modes, signals, weight)
    if direct:
        regressors = np.hstack([regressors, direct_sensitivity(factor[:, filtered_columns:-p], weight)])
    targets = (weight @ factor[:, -p:].T).reshape(-1)
    scale = np.linalg.norm(regressors, axis=0)
    scale[scale == 0.0] = 1.0  # padding
    left, singular, right = thin_svd(regressors / scale)
    kept = singular > _SMALLEST_SINGULAR_VALUE * singular[0]
    left, singular, right = left[:, kept], singular[kept], right[kept]
    along = left.T @ targets
    solution = right.T @ (along / singular) / scale
    gains, d = np.split(solution, [len(solution) - p * direct])
    gains = gains.reshape(blocks, 2, -1)
    errors = targets - left @ along
    sensitivity = _sensitivity(modes, gains, signals, weight)
    unweighted = np.linalg.solve(weight, errors.reshape(p, -1))
    return Fit(
        modes,
        gains,
        unweighted @ unweighted.T,
        errors,
        sensitivity - left @ (left.T @ sensitivity),
        d.reshape(p, direct),
    )


def gain_sensitivity(modes: Modes, signals: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of the weighted predictions by the gains (block, state, channel), shape (p * rows, gains)."""
    v, zv, c = signals[:, 0 : 4 * len(modes.m) : 4], signals[:, 1 : 4 * len(modes.m) : 4], weight @ modes.c
    by_gain = np.einsum("bia,rbj->irbaj", c, zv) - np.einsum("bia,rbj->irbaj", c @ modes.adjoint, v)
    return np.asarray(by_gain.reshape(len(weight) * len(signals), -1))


def direct_sensitivity(inputs: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of the weighted predictions by the entries of D, row by row, shape (p * rows, p * m)."""
    return np.asarray(np.einsum("ia,rj->iraj", weight, inputs).reshape(len(weight) * len(inputs), -1))


def _sensitivity(
    modes: Modes, gains: NDArray[np.float64], signals: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Derivatives of the weighted predictions by the entries of `modes.places`, then `modes.c`, the gains held."""
    blocks = len(modes.m)
    v, zv, s, zs = (signals[:, kind : 4 * blocks : 4] for kind in range(4))
    r, zr = signals[:, 4 * blocks :: 2], signals[:, 4 * blocks + 1 :: 2]
    adjoint, c, determinant = modes.adjoint, weight @ modes.c, modes.determinant
    rows = len(weight) * len(signals)
    by_c = np.einsum("bac,rbc->rba", gains, zv) - np.einsum("bac,rbc->rba", adjoint @ gains, v)
    by_f = np.empty((len(weight), len(signals), len(modes.places), 2, 2))
    for place, (i, j) in enumerate(modes.places):
        pair = (place - blocks) // 2
        twice, then = (s[:, i], zs[:, i]) if i == j else (r[:, pair], zr[:, pair])
        # C_i (z I - M_i)^-1 change (z I - M_j)^-1 G_j w, with z^2 of the numerator divided by the denominator of i.
        now, then, twice = (gains[j] @ signal.T for signal in (v[:, j], then, twice))
        direct = now + modes.trace[i] * then - adjoint[j] @ then - determinant[i] * twice
        turned = adjoint[j] @ twice - then
        by_f[:, :, place] = np.einsum("ia,br->irab", c[i], direct) + np.einsum("ia,br->irab", c[i] @ adjoint[i], turned)
    return np.hstack([by_f.reshape(rows, -1), np.einsum("il,rba->irbla", weight, by_c).reshape(rows, -1)])


def _signals(modes: Modes) -> int:
    """Signals of each channel: v, z v, s, z s of every block, then r, z r of every pair."""
    return 4 * len(modes.m) + 2 * len(modes.pairs)


def _factor(
    modes: Modes,
    inputs: NDArray[np.float64],
    direct: NDArray[np.float64],
    outputs: NDArray[np.float64],
    parts: list[slice],
) -> NDArray[np.float64]:
    """Triangular factor of filters' signals (signal, channel), direct inputs, outputs, over the root of steps.

    All are without their means over all steps: the factor of them with a constant before them, less its row and column.
    """
    steps, measured = len(inputs), inputs.shape[1] + outputs.shape[1]
    w = np.hstack([inputs, outputs, np.zeros((steps, len(parts)))])
    triangle = np.zeros((0, 1 + _signals(modes) * w.shape[1] + direct.shape[1] + outputs.shape[1]))
    for index, experiment in enumerate(parts):
        state = np.zeros((_signals(modes), w.shape[1]))
        state[1 : 4 * len(modes.m) : 4, measured + index] = 1.0  # z v of the impulse one step before the first sample
        for start in range(experiment.start, experiment.stop, _BLOCK):
            part = slice(start, min(start + _BLOCK, experiment.stop))
            signals = np.empty((len(w[part]), *state.shape))
            _filter(modes.trace, modes.determinant, _pairs(modes), w[part], state, signals)
            constant, flat = np.ones((len(signals), 1)), signals.reshape(len(signals), -1)
            triangle = with_rows(triangle, np.hstack([constant, flat, direct[part], outputs[part]]))
    return triangle[1:, 1:] / math.sqrt(steps)


def filtered(modes: Modes, w: NDArray[np.float64]) -> NDArray[np.float64]:
    """All signals of every channel of w, from rest, shape (steps, signals, channels); see `_signals`."""
    signals = np.empty((len(w), _signals(modes), w.shape[1]))
    _filter(modes.trace, modes.determinant, _pairs(modes), w, np.zeros(signals.shape[1:]), signals)
    return signals


def _pairs(modes: Modes) -> NDArray[np.int64]:
    return np.array(modes.pairs, dtype=np.int64).reshape(-1, 2)


@numba.njit(cache=True)
def _filter(
    trace: NDArray[np.float64],
    determinant: NDArray[np.float64],
    pairs: NDArray[np.int64],
    w: NDArray[np.float64],
    state: NDArray[np.float64],
    signals: NDArray[np.float64],
) -> None:
    """Fill in all signals of every channel, shape (steps, signals, channels); advance `state`."""
    blocks = len(trace)
    for step in range(len(w)):
        signals[step] = state
        for pair in range(len(pairs)):
            first, second, place = pairs[pair, 0], pairs[pair, 1], 4 * blocks + 2 * pair
            for channel in range(w.shape[1]):
                r, zr = state[place, channel], state[place + 1, channel]
                state[place, channel] = zr
                state[place + 1, channel] = trace[second] * zr - determinant[second] * r + state[4 * first, channel]
        for block in range(blocks):
            t, d = trace[block], determinant[block]
            now = state[4 * block : 4 * block + 4]
            for channel in range(w.shape[1]):
                v, zv, s, zs = now[0, channel], now[1, channel], now[2, channel], now[3, channel]
                now[0, channel], now[1, channel] = zv, t * zv - d * v + w[step, channel]
                now[2, channel], now[3, channel] = zs, t * zs - d * s + v
