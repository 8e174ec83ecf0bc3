"""Best linear approximation from fewer experiments than references: a polynomial over neighbouring lines.

Random phases make the references of neighbouring lines independent, while the response of the loop changes little from
one line to the next. In a window about each line it is taken as a polynomial of the line's number, at most a quadratic.

Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, section
7.2 (local polynomial method), without its transient, as the motion is periodic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError

LEAST_INDEPENDENCE = 0.03
"""Of a column of the least squares from those before it, as a share of its length."""
_SPARE = 6  # equations beyond the unknowns in a window
_HIGHEST_DEGREE = 2

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class LocalFit:
    """Responses of q signals to m references, from windows of neighbouring lines.

    Attributes
    ----------
    at : ndarray of int, shape (f,)
        Places of the lines among all of them.
    response : ndarray, shape (f, q, m)
        The responses.
    weights : ndarray, shape (f, m, m)
        Covariance of a row of them for a variance of 1 of the signals.
    noise : ndarray, shape (f, q, q)
        Covariance of what the polynomials leave: noise, distortion and errors of the polynomials.
    power : ndarray, shape (f, q)
        Mean power of the signals in the window.
    independent : ndarray of bool, shape (f,)
        Whether the references in the window are independent.
    free : int
        Equations beyond the unknowns in a window.
    """

    at: NDArray[np.int_]
    response: Complex
    weights: Complex
    noise: Complex
    power: NDArray[np.float64]
    independent: NDArray[np.bool_]
    free: int


def fit_between_lines(
    lines: NDArray[np.int_], reference: Complex, signals: Complex, most: int | None = None
) -> LocalFit:
    """Responses of signals to the references at each line, or at so many of them at most.

    Parameters
    ----------
    lines : ndarray of int, shape (n,)
        Excited lines, ascending.
    reference : ndarray, shape (n, m, experiments)
        References that move.
    signals : ndarray, shape (n, q, experiments)
        What answers to them.
    most : int, optional
        Number of lines at which to fit; windows then cover all lines.

    Raises
    ------
    SpectrumError
        If there are too few lines.
    """
    count, columns, experiments = reference.shape
    degree = max(
        (n for n in range(_HIGHEST_DEGREE + 1) if (n + 1) * columns + _SPARE <= count * experiments), default=None
    )
    if degree is None:
        raise SpectrumError(f"{count} excited lines are too few to separate the responses to the references")
    stride = 1 if most is None else -(-count // most)
    width = min(count, max(stride, -(-((degree + 1) * columns + _SPARE) // experiments)))
    at = np.arange(stride // 2, count, stride)
    free = width * experiments - (degree + 1) * columns
    fitted = zip(*(_fit(lines, reference, signals, index, width, degree) for index in at), strict=True)
    response, weights, noise, power, independent = map(np.array, fitted)
    return LocalFit(at, response, weights, noise, power, independent, free)


def _fit(
    lines: NDArray[np.int_], reference: Complex, signals: Complex, index: int, width: int, degree: int
) -> tuple[Complex, Complex, Complex, NDArray[np.float64], bool]:
    """Response, weights, noise, power and independence at one line."""
    count, columns, _ = reference.shape
    first = min(max(index - width // 2, 0), count - width)
    part = slice(first, first + width)
    offset = (lines[part] - lines[index]) / max(np.ptp(lines[part]), 1)
    powers = offset[:, np.newaxis] ** np.arange(degree + 1)
    regressors = np.einsum("kd,kme->kedm", powers, reference[part]).reshape(-1, (degree + 1) * columns)
    right = np.moveaxis(signals[part], 1, 2).reshape(len(regressors), -1)
    inverse = np.linalg.pinv(regressors)
    left = right - regressors @ (inverse @ right)
    size = np.linalg.norm(regressors, axis=0)
    own = np.abs(np.diagonal(np.linalg.qr(regressors / np.where(size > 0.0, size, 1.0), mode="r")))
    return (
        (inverse @ right)[:columns].T,
        (inverse.conj() @ inverse.T)[:columns, :columns],
        left.T @ left.conj() / (len(regressors) - regressors.shape[1]),
        np.mean(np.abs(right) ** 2, axis=0),
        bool(np.all(size > 0.0) and own.min() >= LEAST_INDEPENDENCE),
    )
