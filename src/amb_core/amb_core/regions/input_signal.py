"""Frequency, amplitude and phase of a sine input, determined from the reference itself, sample by sample.

Differences of the reference do not depend on its nominal value. With the first difference e and the second difference h
of e, a sine of angular frequency w (per sample) obeys h = -q e, q = 4 sin^2(w/2), and only a sine does: q is fitted
over one period or more, and one minus the squared correlation of h and e shows how far the input is from a sine. The
phase follows from the central differences d1 = 2 A sin(w) cos(phase) and d2 = -q A sin(phase).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numba
import numpy as np
from numpy.typing import NDArray

SPANS = (1, 2, 4, 8, 16)  # update intervals over which a frequency is fitted; the shortest with a full period is used
NOT_A_SINE = 0.05  # one minus squared correlation: white noise has 0.1, a sweep of 250 Hz/s less above about 25 Hz
STRIDES = (1, 2, 4, 8)  # samples over which the differences of a noisy sine are taken
MEMORY = 2.0  # s for which an input is remembered after its last change: squares rest between their edges
KIND_UPDATES = 5  # updates for which another kind of input must last to count as another excitation
AMPLITUDE_STEP = 1.25  # ratio of amplitudes of a sine from one update to the next that counts as another excitation
HIGHEST = 0.98  # of the Nyquist frequency: above, the samples of a sine no longer determine its phase


class InputKind(IntEnum):
    """What the reference does."""

    NONE = 0
    SINE = 1
    OTHER = 2


@dataclass(frozen=True)
class InputFeatures:
    """The input at one update.

    Attributes
    ----------
    kind : InputKind
        None, a sine (a sweep is one), or anything else.
    frequency : float
        Of the sine, else root mean square frequency (Hz); 0 without input.
    amplitude : float
        Peak amplitude of the sine, else square root of twice the variance (m).
    span : int
        Update intervals over which these were fitted.
    """

    kind: InputKind
    frequency: float
    amplitude: float
    span: int


NO_INPUT = InputFeatures(InputKind.NONE, 0.0, 0.0, 1)


@numba.njit(cache=True, error_model="numpy")
def difference_moments(reference: NDArray[np.float64], base: float, moments: NDArray[np.float64]) -> None:
    """Sums of one interval; `reference` holds three samples of the past before it.

    `moments`, shape (5,), receives the sums of h e, e^2, h^2, r - base and its square.
    """
    moments[:] = 0.0
    for k in range(3, len(reference)):
        first = reference[k - 1] - reference[k - 2]
        second = reference[k] - reference[k - 1] - 2.0 * first + reference[k - 2] - reference[k - 3]
        moved = reference[k] - base
        moments[0] += second * first
        moments[1] += first * first
        moments[2] += second * second
        moments[3] += moved
        moments[4] += moved * moved


@numba.njit(cache=True, error_model="numpy")
def sine_parts(
    reference: NDArray[np.float64], angular: float, cosine: NDArray[np.float64], sine: NDArray[np.float64]
) -> float:
    """Cosine and sine of the phase at each sample but the first and last; returns the root mean square amplitude.

    `angular` is the angular frequency per sample (rad); `cosine` and `sine` are two samples shorter than `reference`.
    """
    q = 4.0 * np.sin(0.5 * angular) ** 2
    double = 2.0 * np.sin(angular)
    power = 0.0
    for k in range(len(cosine)):
        in_phase = (reference[k + 2] - reference[k]) / double
        quadrature = -(reference[k + 2] - 2.0 * reference[k + 1] + reference[k]) / q
        squared = in_phase * in_phase + quadrature * quadrature
        scale = 1.0 / np.sqrt(squared) if squared > 0.0 else 0.0
        cosine[k], sine[k] = in_phase * scale, quadrature * scale
        power += squared
    return np.sqrt(power / len(cosine))


def sine_frequency(signal: NDArray[np.float64], sample_time: float) -> float:
    """Frequency of a signal that is a sine with little noise; NaN of another one, and below one period.

    Differences over one sample amplify noise by the square of the samples per period. So they are taken over 2, 4 and 8
    samples too, each up to a sixth of a period: beyond, a square looks like a sine.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        The signal.
    sample_time : float
        Sample time (s).

    Returns
    -------
    float
        Frequency (Hz).
    """
    for lag in STRIDES:
        first = signal[lag:] - signal[:-lag]
        second = first[2 * lag :] - 2.0 * first[lag:-lag] + first[: -2 * lag]
        first = first[lag:-lag]
        product, power, power_of_second = second @ first, first @ first, second @ second
        if -power < product < 0.0 and 1.0 - product**2 / (power * power_of_second) < NOT_A_SINE:
            frequency = math.asin(0.5 * math.sqrt(-product / power)) / (math.pi * lag * sample_time)
            return frequency if frequency * len(signal) * sample_time >= 1.0 else math.nan
    return math.nan


class InputTracker:
    """Follows the reference of one axis from update to update.

    Parameters
    ----------
    sample_time : float
        Controller sample time (s).
    interval : int
        Steps of an update interval.

    Attributes
    ----------
    origin : float
        Reference at rest, or its mean over the first intervals where it moves from the start (m).
    """

    def __init__(self, sample_time: float, interval: int) -> None:
        self._sample_time = sample_time
        self._interval = interval
        self._moments = np.zeros((SPANS[-1], 5))
        self._known = 0
        self._base = math.nan
        self.origin = 0.0
        self._memory = round(MEMORY / (interval * sample_time))
        self._rest = self._memory
        self._from_start = True

    def update(self, reference: NDArray[np.float64]) -> InputFeatures:
        """Add an interval of the reference (m) with the three samples before it, shape (interval + 3,)."""
        if math.isnan(self._base):
            self._base = self.origin = float(reference[0])
        self._moments[:-1] = self._moments[1:].copy()
        difference_moments(reference, self._base, self._moments[-1])
        moves = self._moments[-1, 1] > 0.0
        self._rest = 0 if moves else min(self._rest + 1, self._memory)
        if self._rest == self._memory:
            self._from_start = False
            self.origin = float(reference[-1])
            return NO_INPUT
        if self._from_start:
            count = self._known + 1
            self.origin = self._base + float(self._moments[-count:, 3].sum()) / (count * self._interval)
            self._from_start = count < SPANS[-1]
        self._known = min(self._known + 1, SPANS[-1])
        for span in SPANS:
            sums = self._moments[-span:].sum(axis=0)
            sine = self._sine(sums, span) if span <= self._known else None
            if sine is not None:
                return sine
        return self._other(sums)

    def _sine(self, sums: NDArray[np.float64], span: int) -> InputFeatures | None:
        """The sine, if these sums are those of a sine and cover a period of it."""
        product, first, second = sums[:3]
        if not (product < 0.0 and 1.0 - product**2 / (first * second) < NOT_A_SINE):
            return None
        angular = 2.0 * math.asin(min(1.0, 0.5 * math.sqrt(-product / first)))
        frequency = angular / (2.0 * math.pi * self._sample_time)
        if frequency * span * self._interval * self._sample_time < 1.0:
            return None
        # the mean square of a first difference is that of the sine times q / 2
        amplitude = math.sqrt(2.0 * first / (span * self._interval)) / (2.0 * math.sin(0.5 * angular))
        return InputFeatures(InputKind.SINE, frequency, amplitude, span)

    def _other(self, sums: NDArray[np.float64]) -> InputFeatures:
        steps = SPANS[-1] * self._interval
        variance = max(float(sums[4] / steps - (sums[3] / steps) ** 2), 0.0)
        if variance == 0.0:
            return InputFeatures(InputKind.OTHER, 0.0, 0.0, SPANS[-1])
        half = min(1.0, 0.5 * math.sqrt(sums[1] / steps / variance))
        frequency = math.asin(half) / (math.pi * self._sample_time)
        return InputFeatures(InputKind.OTHER, frequency, math.sqrt(2.0 * variance), SPANS[-1])


class ExcitationChange:
    """Detects that the excitation of an axis changes, in its kind or in the amplitude of a sine.

    Mixed tones and noise sometimes look like a sine: changes within `MEMORY` of each other are one excitation.

    Parameters
    ----------
    update_time : float
        Time from one update to the next (s).
    """

    def __init__(self, update_time: float) -> None:
        self._memory = round(MEMORY / update_time)
        self._kind = InputKind.NONE
        self._amplitude = 0.0
        self._other_kind = 0
        self._age = self._memory

    def update(self, features: InputFeatures) -> bool:
        """Add the input at an update; returns whether the excitation changed."""
        self._age += 1
        before, self._amplitude = self._amplitude, features.amplitude
        if features.kind != self._kind:
            self._other_kind += 1
            if self._other_kind < KIND_UPDATES:
                return False
            starts = InputKind.NONE in (features.kind, self._kind)
            self._kind = features.kind
        else:
            self._other_kind = 0
            if features.kind != InputKind.SINE or before == 0.0:
                return False
            if 1.0 / AMPLITUDE_STEP < features.amplitude / before < AMPLITUDE_STEP:
                return False
            starts = False
        self._other_kind = 0
        lasted, self._age = self._age > self._memory, 0
        return starts or lasted
