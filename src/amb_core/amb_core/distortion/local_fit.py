"""Best linear approximation from fewer experiments than references: a polynomial over neighbouring lines.

Random phases make the references of neighbouring lines independent, while the response of the loop changes little from
one line to the next. In a window about each line it is taken as a polynomial of the line's number, at most a quadratic.

Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, section
7.2 (local polynomial method), without its transient, as the motion is periodic.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import SpectrumError

_SPARE = 6  # equations beyond the unknowns in a window
_HIGHEST_DEGREE = 2

Complex = NDArray[np.complex128]


def fit_between_lines(
    lines: NDArray[np.int_], reference: Complex, position: Complex, current: Complex
) -> tuple[Complex, Complex, Complex, NDArray[np.float64]]:
    """Responses of positions and currents to the references at each line.

    Parameters
    ----------
    lines : ndarray of int, shape (n,)
        Excited lines, ascending.
    reference : ndarray, shape (n, m, experiments)
        References that move.
    position, current : ndarray, shape (n, p, experiments)
        What answers to them.

    Returns
    -------
    to_position, to_current : ndarray, shape (n, p, m)
        The responses.
    weights : ndarray, shape (n, m, m)
        Covariance of a row of them for a variance of 1 of the answers.
    left : ndarray, shape (n, p)
        Variance of what the polynomials leave of the positions: noise, distortion and errors of the polynomials.

    Raises
    ------
    SpectrumError
        If there are too few lines.
    """
    count, columns, experiments = reference.shape
    answers = np.concatenate([position, current], axis=1)
    outputs = position.shape[1]
    degree = max(
        (n for n in range(_HIGHEST_DEGREE + 1) if (n + 1) * columns + _SPARE <= count * experiments), default=None
    )
    if degree is None:
        raise SpectrumError(f"{count} excited lines are too few to separate the responses to the references")
    width = min(count, -(-((degree + 1) * columns + _SPARE) // experiments))
    found = np.empty((count, answers.shape[1], columns), dtype=complex)
    weights = np.empty((count, columns, columns), dtype=complex)
    left = np.empty((count, outputs))
    for index in range(count):
        first = min(max(index - width // 2, 0), count - width)
        part = slice(first, first + width)
        offset = (lines[part] - lines[index]) / max(np.ptp(lines[part]), 1)
        powers = offset[:, np.newaxis] ** np.arange(degree + 1)
        regressors = np.einsum("kd,kme->kedm", powers, reference[part]).reshape(width * experiments, -1)
        right = np.moveaxis(answers[part], 1, 2).reshape(width * experiments, -1)
        inverse = np.linalg.pinv(regressors)
        found[index] = (inverse @ right)[:columns].T
        weights[index] = (inverse @ inverse.conj().T)[:columns, :columns]
        rest = (right - regressors @ (inverse @ right))[:, :outputs]
        left[index] = (np.abs(rest) ** 2).sum(axis=0) / (len(regressors) - regressors.shape[1])
    return found[:, :outputs], found[:, outputs:], weights, left
