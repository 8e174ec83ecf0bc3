"""Responses of inputs and outputs to the references at some frequencies: what an estimate of the plant starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST_POWER = 1e-12  # of a reference at a frequency, relative to the largest
LEAST_INDEPENDENCE = 1e-6  # smaller eigenvalue of the references' correlation
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Signals:
    """The signals of an experiment: references, or the inputs that take their place, inputs and outputs."""

    references: NDArray[np.float64]
    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]

    @property
    def all(self) -> NDArray[np.float64]:
        """References, inputs and outputs beside one another, shape (steps, q)."""
        return np.hstack([self.references, self.inputs, self.outputs])


@dataclass(frozen=True, eq=False)
class ByReferences:
    """Responses of z = (u, y) to p references, m inputs and q outputs, where the references determine them.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    response : ndarray, shape (f, m + q, p)
        From the references to inputs and outputs.
    noise : ndarray, shape (f, m + q, m + q)
        Covariance of what the references do not explain of a term.
    spread : ndarray, shape (f, p, p)
        Covariance of a row of the response for a noise of 1.
    coherence : ndarray, shape (f, m + q)
        Share of the power of each that the references explain.
    free_terms : float
        Independent terms, minus those that the response itself uses, from which the noise is estimated.
    method : str
        How it was estimated.
    """

    frequency: NDArray[np.float64]
    response: Complex
    noise: Complex
    spread: Complex
    coherence: NDArray[np.float64]
    free_terms: float
    method: str


def from_sums(
    frequency: NDArray[np.float64], sums: Complex, terms: float, references: int, method: str, fewest_free: float = 1.0
) -> ByReferences:
    """Responses from sums z z^H of z = (r, u, y), shape (f, p + m + q, p + m + q), of independent terms.

    Frequencies at which the references do not separate are left out. Where the free terms of a frequency are fewer than
    wanted, the noise is the mean over as many neighbouring frequencies as needed.
    """
    r, z = slice(0, references), slice(references, None)
    kept = _independent(sums[:, r, r])
    free = terms - references
    if free < 1.0:
        kept = np.zeros_like(kept)
    frequency, sums = frequency[kept], sums[kept]
    spread = np.linalg.inv(sums[:, r, r])
    response = sums[:, z, r] @ spread
    explained = response @ sums[:, r, z]
    left = sums[:, z, z] - explained
    index = np.arange(left.shape[1])
    left[:, index, index] = np.maximum(left[:, index, index].real, 0.0)  # rounding may not make them negative
    together = max(1, min(int(np.ceil(fewest_free / max(free, 1.0))), len(sums)))
    noise = _running_mean(left / max(free, 1.0), together)
    power = np.diagonal(sums[:, z, z], axis1=1, axis2=2).real / terms
    share = np.diagonal(noise, axis1=1, axis2=2).real / np.maximum(power, np.finfo(float).tiny)
    return ByReferences(
        frequency, response, noise, np.asarray(spread), np.clip(1.0 - share, 0.0, 1.0), free * together, method
    )


def _running_mean(values: Complex, count: int) -> Complex:
    """Means over so many neighbours along the first axis, at the ends those nearest."""
    if count == 1:
        return values
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    first = np.clip(np.arange(len(values)) - count // 2, 0, len(values) - count)
    return np.asarray((sums[first + count] - sums[first]) / count)


def _independent(power: Complex) -> NDArray[np.bool_]:
    """Whether all references have power at a frequency and are not multiples of one another; shape (f,)."""
    own = np.diagonal(power, axis1=1, axis2=2).real
    strong = np.all(own > LEAST_POWER * own.max(axis=0), axis=1) & np.all(own > 0.0, axis=1)
    scale = np.sqrt(np.where(strong[:, np.newaxis], own, 1.0))
    correlation = np.where(strong[:, np.newaxis, np.newaxis], power, 0.0) / (scale[:, :, None] * scale[:, None, :])
    return np.asarray(strong & (np.linalg.eigvalsh(correlation)[:, 0] > LEAST_INDEPENDENCE))
