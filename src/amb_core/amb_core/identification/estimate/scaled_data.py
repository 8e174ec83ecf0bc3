"""Data prepared for estimation: checked, without means, each signal scaled to unit variance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import numbers
from amb_core.identification.estimate.predictor import innovations
from amb_core.linear.model.state_space import StateSpaceModel

HIGHEST_ORDER = 40
_SMALLEST_MAGNITUDE = 1e-30  # far from the limits of floating point, so that variances are neither zero nor infinite
_SMALLEST_EIGENVALUE = 1e-12  # of the correlation matrix of all signals

Samples = NDArray[np.float64] | Sequence[NDArray[np.float64]]  # of one experiment, or of each of several


@dataclass(frozen=True)
class ScaledData:
    """m inputs and p outputs with mean 0 and variance 1, and the offsets and scales of the original units.

    Attributes
    ----------
    inputs, outputs : ndarray, shapes (steps, m), (steps, p)
        The scaled signals, experiments one after the other.
    lengths : tuple of int
        Steps of each experiment.
    input_offset, input_scale : ndarray, shape (m,)
        Means and standard deviations of the original inputs.
    output_offset, output_scale : ndarray, shape (p,)
        The same of the original outputs.
    """

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    lengths: tuple[int, ...]
    input_offset: NDArray[np.float64]
    output_offset: NDArray[np.float64]
    input_scale: NDArray[np.float64]
    output_scale: NDArray[np.float64]

    @classmethod
    def of(cls, inputs: Samples, outputs: Samples) -> ScaledData:
        """Check and scale inputs and outputs of shapes (steps, m), (steps, p).

        Of several experiments, given as two lists of such arrays, the mean over all is removed.

        Raises
        ------
        IdentificationError
            If a signal is not finite, constant, absurdly large or small, or follows from the others, or if the shapes
            do not fit together.
        """
        inputs, input_lengths = _joined("input", inputs)
        outputs, lengths = _joined("output", outputs)
        if input_lengths != lengths:
            raise IdentificationError(
                f"inputs and outputs must have the same numbers of samples, not {input_lengths} and {lengths}"
            )
        _check_samples("input", inputs)
        _check_samples("output", outputs)
        input_offset, output_offset = inputs.mean(axis=0), outputs.mean(axis=0)
        input_scale, output_scale = inputs.std(axis=0), outputs.std(axis=0)
        u, y = (inputs - input_offset) / input_scale, (outputs - output_offset) / output_scale
        _check_independence(np.hstack([u, y]))
        return cls(u, y, lengths, input_offset, output_offset, input_scale, output_scale)

    def model(
        self,
        a: NDArray[np.float64],
        b: NDArray[np.float64],
        c: NDArray[np.float64],
        k: NDArray[np.float64],
        initial_states: NDArray[np.float64],
        sample_time: float,
        method: str,
        source: str,
        d: NDArray[np.float64] | None = None,
        constant: bool = False,
    ) -> StateSpaceModel:
        """A model of the scaled signals in the original units, with the covariance of its innovations on these data.

        Its initial state is that of the first experiment. Without `d` it has no direct feedthrough.
        With `constant` the mean of its prediction errors becomes part of its offsets.
        """
        errors = innovations(a, b, c, k, initial_states, self.inputs, self.outputs, self.lengths, d)
        offsets = np.zeros(b.shape[1] + len(c))
        if constant:
            offsets, shift = _equilibrium(a, b, c, k, d, errors.mean(axis=0))
            initial_states = initial_states - shift
        covariance = np.atleast_2d(np.cov(errors.T, bias=True))
        d = np.zeros((len(c), b.shape[1])) if d is None else d
        return StateSpaceModel(
            a=a,
            b=b / self.input_scale,
            c=c * self.output_scale[:, np.newaxis],
            d=d * self.output_scale[:, np.newaxis] / self.input_scale,
            k=k / self.output_scale,
            innovation_covariance=covariance * np.outer(self.output_scale, self.output_scale),
            input_offset=self.input_offset + offsets[: b.shape[1]] * self.input_scale,
            output_offset=self.output_offset + offsets[b.shape[1] :] * self.output_scale,
            initial_state=initial_states[0],
            sample_time=sample_time,
            method=method,
            source=source,
            samples=len(errors),
            **_labels(*d.shape),
        )


def _equilibrium(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    k: NDArray[np.float64],
    d: NDArray[np.float64] | None,
    mean: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The smallest offsets of inputs and outputs that explain a mean of the prediction errors, and of the states."""
    b = b if d is None else b - k @ d
    to_state = np.linalg.solve(np.eye(len(a)) - a + k @ c, np.hstack([b, k]))
    direct = np.hstack([np.zeros((len(c), b.shape[1])) if d is None else -d, np.eye(len(c))])
    offsets = np.linalg.lstsq(direct - c @ to_state, mean, rcond=None)[0]
    return offsets, to_state @ offsets


def check_order(order: int) -> None:
    """Reject an order that no method supports.

    Raises
    ------
    IdentificationError
        If the order is not a whole number, below 1 or above `HIGHEST_ORDER`.
    """
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)):
        raise IdentificationError(
            f"an order of type {type(order).__name__} is not allowed; allowed: whole numbers from 1 to {HIGHEST_ORDER}"
        )
    if not 1 <= order <= HIGHEST_ORDER:
        raise IdentificationError(f"order {order} is not allowed; allowed: 1 to {HIGHEST_ORDER}")


def _labels(outputs: int, inputs: int) -> dict[str, Any]:
    """Numbered names without units, but for two inputs and two outputs, which are those of a bearing by default."""
    if (inputs, outputs) == (2, 2):
        return {}
    return {
        "input_names": [f"u{number + 1}" for number in range(inputs)],
        "output_names": [f"y{number + 1}" for number in range(outputs)],
        "input_units": ("",) * inputs,
        "output_units": ("",) * outputs,
    }


def _joined(kind: str, samples: Samples) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """All experiments in one array, and the steps of each."""
    given = [samples] if isinstance(samples, np.ndarray) or not isinstance(samples, Iterable) else samples
    parts = [
        part
        if isinstance(part, np.ndarray) and part.dtype == np.float64
        else numbers(f"{kind}s", part, IdentificationError)
        for part in given
    ]
    for part in parts:
        if part.ndim != 2 or 0 in part.shape:
            raise IdentificationError(
                f"{kind}s of shape {part.shape} are not allowed; allowed: (steps, signals), one column for each "
                f"{kind}, with one step or more"
            )
        if part.shape[1] != parts[0].shape[1]:
            raise IdentificationError(
                f"experiments with {parts[0].shape[1]} and {part.shape[1]} {kind}s cannot be joined; "
                f"all need the same {kind}s"
            )
    if not parts:
        raise IdentificationError(f"there are no {kind}s; at least one experiment is needed")
    return np.ascontiguousarray(np.vstack(parts), dtype=np.float64), tuple(len(part) for part in parts)


def _check_samples(kind: str, samples: NDArray[np.float64]) -> None:
    finite = np.isfinite(samples).all(axis=1)
    if not finite.all():
        step = int(np.argmin(finite))
        raise IdentificationError(f"{kind} is not finite at sample {step}: {samples[step].tolist()}")
    for column, signal in enumerate(samples.T):
        if np.ptp(signal) == 0.0:
            raise IdentificationError(
                f"{kind} {column + 1} is constant at {signal[0]:g}; all signals must move to be identified"
            )
        largest = float(np.max(np.abs(signal)))
        if not _SMALLEST_MAGNITUDE < largest < 1.0 / _SMALLEST_MAGNITUDE:
            raise IdentificationError(
                f"{kind} {column + 1} has a largest magnitude of {largest:g}; "
                f"allowed: {_SMALLEST_MAGNITUDE:g} to {1.0 / _SMALLEST_MAGNITUDE:g}"
            )


def _check_independence(signals: NDArray[np.float64]) -> None:
    """Reject linearly dependent signals (inputs, then outputs, each with mean 0 and variance 1)."""
    eigenvalues = np.linalg.eigvalsh(signals.T @ signals / len(signals))
    if eigenvalues[0] < _SMALLEST_EIGENVALUE:
        raise IdentificationError(
            "inputs and outputs are not independent (one is a sum of multiples of the others); "
            "excite the inputs independently"
        )
