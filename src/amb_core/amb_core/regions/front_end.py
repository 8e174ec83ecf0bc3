"""From samples to update intervals: the past that filters need, decimated signals, phase of the input and response."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.regions.input_signal import (
    HIGHEST,
    NO_INPUT,
    SPANS,
    InputFeatures,
    InputKind,
    InputTracker,
    sine_frequency,
    sine_parts,
)
from amb_core.regions.parameters import PER_INTERVAL
from amb_core.regions.slow_signal import TAPS, decimate, decimation_filter

DISTORTION_SPAN = 4  # spans of the input over which harmonics of the position are fitted, against noise
HIGHEST_DISTORTION = 0.45  # of the sample rate: the third harmonic must lie below
PAST = 6.0  # s of decimated signals that are kept: a mode of 15 Hz with a damping ratio of 0.01 decays within 4 s


@numba.njit(cache=True, error_model="numpy")
def response_moments(
    position: NDArray[np.float64], cosine: NDArray[np.float64], sine: NDArray[np.float64], moments: NDArray[np.float64]
) -> None:
    """Sums of a fit of 1, cos, sin to an interval of the position, shape (9,)."""
    moments[:] = 0.0
    for k in range(len(position)):
        y, c, s = position[k], cosine[k], sine[k]
        moments[0] += 1.0
        moments[1] += c
        moments[2] += s
        moments[3] += c * c
        moments[4] += c * s
        moments[5] += s * s
        moments[6] += y
        moments[7] += y * c
        moments[8] += y * s


@numba.njit(cache=True, error_model="numpy")
def fitted_amplitude(moments: NDArray[np.float64], span: int) -> float:
    """Amplitude of the sine in the latest `span` intervals; 0 at the Nyquist frequency, where it is undetermined."""
    sums = np.zeros(9)
    for row in range(len(moments) - span, len(moments)):
        sums += moments[row]
    ones, c, s, cc, cs, ss, y, yc, ys = sums
    if ones == 0.0:
        return 0.0
    cc, cs, ss = cc - c * c / ones, cs - c * s / ones, ss - s * s / ones
    yc, ys = yc - y * c / ones, ys - y * s / ones
    determinant = cc * ss - cs * cs
    if determinant < 1e-6 * ones * ones:
        return 0.0
    return np.hypot((ss * yc - cs * ys) / determinant, (cc * ys - cs * yc) / determinant)


@numba.njit(cache=True, error_model="numpy")
def harmonic_moments(
    position: NDArray[np.float64], cosine: NDArray[np.float64], sine: NDArray[np.float64], moments: NDArray[np.float64]
) -> None:
    """Sums of products of 1, cosine and sine of the first three harmonics, and an interval of the position.

    `cosine` and `sine` are of the input's phase; `moments`, shape (8, 8), receives the sums.
    """
    moments[:] = 0.0
    row = np.empty(8)
    for k in range(len(position)):
        c, s = cosine[k], sine[k]
        row[0], row[1], row[2], row[7] = 1.0, c, s, position[k]
        row[3], row[4] = c * c - s * s, 2.0 * c * s
        row[5], row[6] = c * row[3] - s * row[4], s * row[3] + c * row[4]
        for i in range(8):
            for j in range(i + 1):
                moments[i, j] += row[i] * row[j]
    for i in range(8):
        for j in range(i):
            moments[j, i] = moments[i, j]


def harmonic_ratios(moments: NDArray[np.float64]) -> tuple[float, float]:
    """Amplitudes of second and third harmonic over that of the first, from sums of `harmonic_moments`."""
    try:
        fitted = np.linalg.solve(moments[:7, :7], moments[:7, 7])
    except np.linalg.LinAlgError:
        return math.nan, math.nan
    first, second, third = np.hypot(fitted[1::2], fitted[2::2])
    return (float(second / first), float(third / first)) if first > 0.0 else (math.nan, math.nan)


class Past:
    """The latest decimated samples: references of all axes, then positions (m).

    Parameters
    ----------
    samples : int
        Samples that are kept.
    axes : int
        Number of axes.
    """

    def __init__(self, samples: int, axes: int) -> None:
        self._samples = samples
        self._axes = axes
        self._values = np.empty((2 * samples, 2 * axes))
        self._stop = 0

    def add(self, values: NDArray[np.float64]) -> None:
        """Append samples, shape (n, 2 axes)."""
        if self._stop + len(values) > len(self._values):
            kept = self._latest(self._samples).copy()
            self._values[: len(kept)] = kept
            self._stop = len(kept)
        self._values[self._stop : self._stop + len(values)] = values
        self._stop += len(values)

    def references(self) -> NDArray[np.float64]:
        """References (m), shape (samples kept, axes), the latest last."""
        return self._latest(self._samples)[:, : self._axes]

    def positions(self, samples: int | None = None) -> NDArray[np.float64]:
        """Positions (m), shape (samples, axes), the latest last: all that are kept, or up to so many."""
        return self._latest(self._samples if samples is None else samples)[:, self._axes :]

    def _latest(self, samples: int) -> NDArray[np.float64]:
        return self._values[max(self._stop - samples, 0) : self._stop]


class FrontEnd:
    """Sliding windows of all axes, advanced by one update interval at a time.

    Parameters
    ----------
    sample_time : float
        Controller sample time (s).
    factor : int
        Decimation factor; an update interval has `PER_INTERVAL` times as many steps.
    samples : int
        Decimated samples of the windows.
    neighbours : sequence of sequence of int
        For each axis the other axes, in the order in which their inputs are taken for its own if it has none.

    Attributes
    ----------
    position : ndarray, shape (axes, samples)
        Decimated position (m); the latest sample last.
    reference : ndarray, shape (axes, samples + TAPS - 1)
        Decimated reference (m).
    origin : list of float
        References at rest (m).
    phase : ndarray, shape (axes, samples)
        Phase of the input at the same steps (rad); 0 where it is no sine.
    frequency : ndarray, shape (axes, samples)
        Frequency of the input at the same steps (Hz).
    amplitude : ndarray, shape (axes, samples)
        Amplitude of the input at the same steps (m).
    inputs : list of InputFeatures
        Inputs on the axes.
    sources : list of int
        For each axis, the axis whose input it responds to.
    response : list of float
        Amplitudes (m) of the position of each axis at the frequency of their input; 0 where this is no sine.
    past : Past
        Decimated signals of the latest seconds.
    distortion : list of tuple of float
        For each axis, second and third harmonic of the position over the first; NaN without a sine on this axis.
    """

    def __init__(self, sample_time: float, factor: int, samples: int, neighbours: Sequence[Sequence[int]]) -> None:
        axes = len(neighbours)
        self._neighbours = neighbours
        self._factor = factor
        self._interval = factor * PER_INTERVAL
        self._sample_time = sample_time
        self._coefficients = decimation_filter(factor)
        self._rows = 18 * factor + 4
        self._raw = np.zeros((self._rows, 2 * axes))
        self._decimated = np.empty((PER_INTERVAL, 2 * axes))
        self._trackers = [InputTracker(sample_time, self._interval) for _ in range(axes)]
        self._responses = np.zeros((axes, SPANS[-1], 9))
        self._harmonics = np.zeros((axes, SPANS[-1], 8, 8))
        self.distortion = [(math.nan, math.nan)] * axes
        self._known = 0
        self.origin = [0.0] * axes
        self.inputs = [NO_INPUT] * axes
        self.sources = list(range(axes))
        self.response = [0.0] * axes
        self.position = np.zeros((axes, samples))
        self.reference = np.zeros((axes, samples + TAPS - 1))
        self.phase = np.zeros((axes, samples))
        self.frequency = np.zeros((axes, samples))
        self.amplitude = np.zeros((axes, samples))
        self.past = Past(round(PAST / (factor * sample_time)), axes)

    @property
    def delay(self) -> int:
        """Steps from the latest decimated sample to the latest step."""
        return 4 * self._factor

    def take(self, reference: NDArray[np.float64], position: NDArray[np.float64]) -> bool:
        """Add an interval of reference and position (m), shape (interval, axes) each; true if the past suffices."""
        steps, axes = self._interval, len(self.inputs)
        self._raw[:-steps] = self._raw[steps:].copy()
        self._raw[-steps:, :axes] = reference
        self._raw[-steps:, axes:] = position
        self._known = min(self._known + steps, self._rows + steps)
        if self._known <= self._rows:
            return False
        for axis, tracker in enumerate(self._trackers):
            self.inputs[axis] = tracker.update(self._raw[-steps - 3 :, axis])
        self.sources = [self._source_of(axis) for axis in range(axes)]
        start = self._rows - 17 * self._factor - 1
        decimate(self._raw[start:], self._coefficients, self._factor, self._decimated)
        for axis, tracker in enumerate(self._trackers):
            _shift(self.reference[axis], self._decimated[:, axis])
            self.origin[axis] = tracker.origin
            _shift(self.position[axis], self._decimated[:, axes + axis])
        self.past.add(self._decimated)
        self._follow_sines(start + 4 * self._factor)
        return True

    def input_of(self, axis: int) -> InputFeatures:
        """The input that an axis responds to: its own, or that of another axis if it has none."""
        return self.inputs[self.sources[axis]]

    def noisy_sine_response(self, axis: int) -> float:
        """Response per input of an axis where noise alone keeps its input from being a sine; 0 for other inputs."""
        reference = self.reference[self.sources[axis]]
        sample_time = self._factor * self._sample_time
        frequency = sine_frequency(reference, sample_time)
        if math.isnan(frequency):
            return 0.0
        samples = self.position.shape[1]
        angle = 2.0 * math.pi * frequency * sample_time * np.arange(samples)
        columns = np.column_stack([np.ones(samples), np.cos(angle), np.sin(angle)])
        fitted = np.linalg.lstsq(columns, np.column_stack([reference[-samples:], self.position[axis]]), rcond=None)[0]
        asked, answered = np.hypot(fitted[1], fitted[2])
        return float(answered / asked)

    def _source_of(self, axis: int) -> int:
        """The axis itself if it has an input, otherwise the nearest one that has; its neighbour if there is none."""
        others = self._neighbours[axis]
        excited = (other for other in (axis, *others) if self.inputs[other].kind != InputKind.NONE)
        return next(excited, others[0] if others else axis)

    def is_frozen(self, axis: int) -> bool:
        """Whether the position of an axis has not changed at all although its reference moves: a sensor that stands."""
        moves = self.inputs[axis].kind != InputKind.NONE
        return bool(moves and self._known > self._rows and np.ptp(self._raw[:, len(self.inputs) + axis]) == 0.0)

    def _follow_sines(self, first: int) -> None:
        """Phases of the inputs and response to them in the interval that starts at a row of the past."""
        steps = self._interval
        part = slice(first, first + steps)
        parts = np.zeros((len(self.inputs), 2, steps))
        for axis, features in enumerate(self.inputs):
            angular = 2.0 * math.pi * features.frequency * self._sample_time
            phase = np.zeros(PER_INTERVAL)
            if features.kind == InputKind.SINE and angular < HIGHEST * math.pi:
                around = self._raw[first - 1 : first + steps + 1, axis]
                amplitude = sine_parts(around, angular, parts[axis, 0], parts[axis, 1])
                self.inputs[axis] = replace(features, amplitude=amplitude)
                phase = np.arctan2(parts[axis, 1, :: self._factor], parts[axis, 0, :: self._factor])
            _shift(self.phase[axis], phase)
            _shift(self.frequency[axis], np.full(PER_INTERVAL, features.frequency))
            _shift(self.amplitude[axis], np.full(PER_INTERVAL, self.inputs[axis].amplitude))
        positions = self._raw[part, len(self.inputs) :]
        for axis in range(len(self.inputs)):
            cosine, sine = parts[self.sources[axis]]
            moments = self._responses[axis]
            moments[:-1] = moments[1:].copy()
            response_moments(positions[:, axis], cosine, sine, moments[-1])
            self.response[axis] = fitted_amplitude(moments, self.input_of(axis).span)
            self._note_harmonics(axis, positions[:, axis], cosine, sine)

    def _note_harmonics(
        self, axis: int, position: NDArray[np.float64], cosine: NDArray[np.float64], sine: NDArray[np.float64]
    ) -> None:
        """Distortion of the response to a sine; the phase of a sine is known long enough after `span` intervals."""
        source = self.inputs[axis]
        moments = self._harmonics[axis]
        moments[:-1] = moments[1:].copy()
        harmonic_moments(position, cosine, sine, moments[-1])
        span = min(DISTORTION_SPAN * source.span, SPANS[-1])
        self.distortion[axis] = (math.nan, math.nan)
        if source.kind == InputKind.SINE and 3.0 * source.frequency * self._sample_time < HIGHEST_DISTORTION:
            self.distortion[axis] = harmonic_ratios(moments[-span:].sum(axis=0))


def _shift(window: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """Replace the oldest samples of a window by new ones."""
    window[: -len(values)] = window[len(values) :].copy()
    window[-len(values) :] = values
