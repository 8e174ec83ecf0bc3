"""Response of the closed loop to small excitations: gain at rest from steps, resonance from a sweep.

A PD loop around a magnetic bearing is, below the lag of its amplifiers, of second order with two zeros:

    T(s) = (b_2 s^2 + b_1 s + b_0) / (s^2 + 2 zeta w_0 s + w_0^2).

Its coefficients minimise the weighted equation error |A T - B|^2 / |A_before|^2 over some iterations.

Source: C. K. Sanathanan, J. Koerner, Transfer function synthesis as a ratio of two complex polynomials, IEEE Trans.
Automatic Control 8 (1963) 56-58.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.linear.step_response import SecondOrder
from amb_core.loop.records import LoopRecord

_SETTLED = 0.6  # part of a half period after which the rotor has come to rest
_MARGIN = 1.2  # from the ends of a sweep's band: leakage is largest there
_ITERATIONS = 20
_FEWEST = 8  # frequencies for a fit


@dataclass(frozen=True, eq=False)
class StaticResponse:
    """Position and control current at rest over small steps of the reference of each axis.

    Attributes
    ----------
    gain : ndarray, shape (axes, axes)
        Change of the position (row) over that of the reference of an axis (column) (-).
    current : ndarray, shape (axes, axes)
        Change of the control current (A/m).
    """

    gain: NDArray[np.float64]
    current: NDArray[np.float64]


def static_response(records: list[LoopRecord]) -> StaticResponse:
    """Measure it from steps up and down, one axis after the other.

    Parameters
    ----------
    records : list of LoopRecord
        One for each axis, in their order: while its reference goes up and down, for at least two half periods.

    Returns
    -------
    StaticResponse
        Gains and currents per metre.

    Raises
    ------
    IdentificationError
        If a reference does not go up and down.
    """
    columns = [_static_column(record, axis) for axis, record in enumerate(records)]
    return StaticResponse(
        np.column_stack([gain for gain, _ in columns]), np.column_stack([current for _, current in columns])
    )


def _static_column(record: LoopRecord, axis: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    reference = record.reference[:, axis]
    edges = np.flatnonzero(np.diff(reference)) + 1
    halves = [(first, stop) for first, stop in pairwise(edges) if stop - first > 1]
    if len(halves) < 2:
        raise IdentificationError(f"the reference of {record.axes[axis]} does not go up and down at least once")
    settled = [slice(first + round(_SETTLED * (stop - first)), stop) for first, stop in halves]
    middle = 0.5 * (reference.max() + reference.min())
    means = [
        np.array([np.mean(values[part], axis=0) for part in settled]) for values in (record.position, record.current)
    ]
    levels = np.array([reference[part].mean() for part in settled])
    up = levels > middle
    if up.all() or not up.any():
        raise IdentificationError(f"the reference of {record.axes[axis]} does not go up and down at least once")
    change = levels[up].mean() - levels[~up].mean()
    gain, current = ((mean[up].mean(axis=0) - mean[~up].mean(axis=0)) / change for mean in means)
    return gain, current


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Response of an axis to its own reference.

    Attributes
    ----------
    axis : str
        Its name.
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    response : ndarray of complex, shape (f,)
        Position over reference (-).
    resonance : SecondOrder
        Natural frequency and damping ratio of the fit.
    """

    axis: str
    frequency: NDArray[np.float64]
    response: NDArray[np.complex128]
    resonance: SecondOrder


def closed_loop(record: LoopRecord, axis: int, band: tuple[float, float]) -> ClosedLoop:
    """Measure it from a sweep of the reference of this axis.

    Parameters
    ----------
    record : LoopRecord
        From the first step of the sweep until the rotor has come to rest after it.
    axis : int
        The axis.
    band : tuple of float
        Frequencies of the sweep (Hz); a margin at its ends is left out.

    Returns
    -------
    ClosedLoop
        The response within the band, with its natural frequency and damping.

    Raises
    ------
    IdentificationError
        If the response is not that of a resonance.
    """
    frequency = np.asarray(np.fft.rfftfreq(record.steps, record.sample_time), dtype=np.float64)
    inside = (frequency >= _MARGIN * band[0]) & (frequency <= band[1] / _MARGIN)
    reference, position = (
        np.fft.rfft(signal[:, axis] - signal[-1, axis])[inside] for signal in (record.reference, record.position)
    )
    response = position / reference
    return ClosedLoop(record.axes[axis], frequency[inside], response, fit_second_order(frequency[inside], response))


def fit_second_order(frequency: NDArray[np.float64], response: NDArray[np.complex128]) -> SecondOrder:
    """Natural frequency and damping ratio of the pole pair that explains a response.

    Parameters
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    response : ndarray of complex, shape (f,)
        Position over reference (-).

    Returns
    -------
    SecondOrder
        Natural frequency and damping ratio.

    Raises
    ------
    IdentificationError
        If there are too few frequencies, or the response is not finite or has no such pair.
    """
    if len(frequency) < _FEWEST or not np.isfinite(response).all():
        raise IdentificationError(f"{len(frequency)} frequencies with a finite response; needed: {_FEWEST}")
    scale = 2.0 * np.pi * frequency[-1]
    s = 2j * np.pi * frequency / scale
    matrix = np.column_stack([s * response, response, -(s**2), -s, -np.ones_like(s)])
    right = -(s**2) * response
    weight = np.ones(len(s))
    coefficients = np.zeros(5)
    for _ in range(_ITERATIONS):
        rows, values = weight[:, np.newaxis] * matrix, weight * right
        coefficients = np.linalg.lstsq(
            np.vstack([rows.real, rows.imag]), np.concatenate([values.real, values.imag]), rcond=None
        )[0]
        weight = 1.0 / np.maximum(np.abs(s**2 + coefficients[0] * s + coefficients[1]), 1e-9)
    if not coefficients[1] > 0.0:
        raise IdentificationError("the response to the sweep has no resonance")
    natural = float(np.sqrt(coefficients[1]))
    return SecondOrder(natural * frequency[-1], float(coefficients[0] / (2.0 * natural)))
