"""One axis: evidence for regions B and C from its windows, and where each region begins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.front_end import FrontEnd
from amb_core.regions.history import InputHistory
from amb_core.regions.input_signal import HIGHEST, InputKind
from amb_core.regions.parameters import RegionParameters
from amb_core.regions.slow_signal import (
    HARMONICS,
    INAUDIBLE,
    PER_INTERVAL,
    TAPS,
    fit_window,
    line_table,
    remove_beats,
    repetition,
    slow_line,
    variance_change,
)
from amb_core.regions.state import Onset
from amb_core.regions.trend import TrendTest

MOTION = 1e-6  # m: a decimated reference that moves more shows the static gain of the loop
HIGHEST_HARMONIC = 0.45  # of the decimated rate: decimation removes the harmonics above
ALIAS_MARGIN = 1.3  # of the slow band: a beat is followed from slightly outside the band
LOWEST_BIN = 4  # periods per window: fewer cannot be distinguished from jumps of the bias


@dataclass
class Features:
    """What the windows of an axis show at one update; see `amb_core.regions.state.AxisState`."""

    bias: float = 0.0
    trend: float = 0.0
    trend_significance: float = 0.0
    oscillation_amplitude: float = 0.0
    oscillation_frequency: float = 0.0
    sampling_beat: bool = False


class AxisClassifier:
    """Regions B and C of one axis.

    Parameters
    ----------
    axis : int
        0 for x, 1 for y.
    parameters : RegionParameters
        Thresholds and times.
    front_end : FrontEnd
        Windows of both axes.
    history : InputHistory
        Inputs of the past, for the onsets.
    sample_time : float
        Controller sample time (s).
    interval : int
        Steps of an update interval.

    Attributes
    ----------
    features : Features
        What the latest windows show.
    drift, oscillation : Onset or None
        Onsets of regions B and C while the axis is in them.
    """

    def __init__(
        self,
        axis: int,
        parameters: RegionParameters,
        front_end: FrontEnd,
        history: InputHistory,
        sample_time: float,
        interval: int,
    ) -> None:
        self._axis = axis
        self._parameters = parameters
        self._front_end = front_end
        self._history = history
        self._sample_time = sample_time
        self._interval = interval
        update = interval * sample_time
        samples = front_end.position.shape[1]
        self._window_time = samples / PER_INTERVAL * update
        self._alarm_level = parameters.false_alarm_rate / 3600.0 * update
        self._hold = round(parameters.hold_time / update)
        self._persistence = samples // PER_INTERVAL + 3
        self._patience = samples // PER_INTERVAL // 4
        self._trend = TrendTest(round(parameters.trend_window / update), update, parameters.false_alarm_rate / 3600.0)
        self._table = line_table(samples, int(parameters.slow_frequency * self._window_time))
        self._unexplained, self._residual, self._cleaned = np.empty((3, samples))
        self.reset()

    def reset(self) -> None:
        """Forget evidence and regions: the loop is about to settle."""
        self._trend.reset()
        self._static_gain = 0.0
        self.features = Features()
        self.drift: Onset | None = None
        self.oscillation: Onset | None = None
        self._level = 0.0
        self._drift_rest = self._oscillation_rest = 0
        self._candidate: int | None = None
        self._evidence = 0

    def update(self, step: int) -> None:
        """Evaluate the windows; their latest decimated sample is at `step`."""
        front_end, axis = self._front_end, self._axis
        source = front_end.sources[axis]
        self._source = front_end.inputs[source]
        reference = front_end.reference[source] - front_end.origin[source]
        phase = front_end.phase[source]
        harmonics = 1
        limit = min(0.5 / self._sample_time, HIGHEST_HARMONIC * PER_INTERVAL / (self._interval * self._sample_time))
        if self._source.kind == InputKind.SINE:
            harmonics = max(1, min(HARMONICS, int(limit / self._source.frequency)))
        linear = float(np.ptp(reference)) > INAUDIBLE
        gain = fit_window(
            front_end.position[axis], reference, phase, harmonics, linear, self._unexplained, self._residual
        )
        if self._source.kind == InputKind.OTHER:
            self._take_out_static_response(reference, gain)
        self._judge_bias(step, len(self._unexplained) // PER_INTERVAL // 2)
        self._judge_oscillation(step)

    def _take_out_static_response(self, reference: NDArray[np.float64], gain: float) -> None:
        """Between the edges of a slow square wave, only the static gain separates the response from the bias."""
        middle = len(self._unexplained) // PER_INTERVAL // 2 * PER_INTERVAL
        past = reference[middle - 1 : middle + PER_INTERVAL + TAPS - 1]
        if np.ptp(past) > MOTION:
            if self._static_gain == 0.0:
                self._trend.reset()  # bias points so far contain the response to a constant reference
            self._static_gain = gain
        elif np.ptp(past) <= INAUDIBLE:
            part = slice(middle, middle + PER_INTERVAL)
            position = self._front_end.position[self._axis, part]
            self._unexplained[part] = position - self._static_gain * reference[middle + TAPS - 1]

    def conclude(self, step: int) -> None:
        """The rotor delevitated: also add the bias of the later half of the window, to find a drift that led to it."""
        for part in range(len(self._unexplained) // PER_INTERVAL // 2 + 1, len(self._unexplained) // PER_INTERVAL):
            self._judge_bias(step, part)

    def _judge_bias(self, step: int, part: int) -> None:
        """Region B: add the bias of one interval of the window."""
        parameters, features = self._parameters, self.features
        bias_step = step - len(self._unexplained) * self._interval // PER_INTERVAL + part * self._interval
        features.bias = float(np.mean(self._unexplained[part * PER_INTERVAL : (part + 1) * PER_INTERVAL]))
        if self._history.resonant(bias_step, self._axis):
            if self.drift is None:
                self._trend.reset()
                features.trend = features.trend_significance = 0.0
            return
        latest = self._trend.add(features.bias)
        features.trend, features.trend_significance = latest.slope, latest.significance
        drifting = self._trend.drifting(parameters.drift_threshold)
        if drifting is not None and self.drift is None:
            points, self._level = self._trend.beginning(drifting)
            self.drift = self._history.onset(bias_step + self._interval // 2 - points * self._interval, self._axis)
        displaced = abs(features.bias - self._level) > parameters.drift_threshold
        self._drift_rest = 0 if drifting is not None or displaced else self._drift_rest + 1
        if self._drift_rest > self._hold:
            self.drift = None

    def _judge_oscillation(self, step: int) -> None:
        """Region C: look for a line in the slow band that is not a beat.

        Beating may explain a part of the line, but less than `beat_share`, because the loop may respond to a beat in
        its own way. Such a window counts neither for nor against an oscillation: a real one outlasts the beat.
        """
        parameters, features = self._parameters, self.features
        features.oscillation_amplitude = features.oscillation_frequency = 0.0
        features.sampling_beat = doubtful = found = False
        residual = self._residual
        highest = self._highest_bin()
        if highest > LOWEST_BIN:
            amplitude, line, share, power = slow_line(residual, LOWEST_BIN, highest, self._table)
            loud = power >= 0.5 * parameters.oscillation_threshold**2
            orders = self._beating_orders() if loud else np.empty(0, np.int64)
            if len(orders):
                residual = self._cleaned
                source = self._front_end.sources[self._axis]
                remove_beats(self._residual, self._front_end.phase[source], orders, residual)
                amplitude, line, share, left = slow_line(residual, LOWEST_BIN, highest, self._table)
                explained = 1.0 - left / power
                features.sampling_beat = explained >= parameters.beat_share
                doubtful = explained >= 0.5 * parameters.beat_share
            found = not doubtful and self._is_oscillation(amplitude, share, highest)
            found = found and not self._repeats_with_input(line)
            features.oscillation_amplitude = amplitude
            features.oscillation_frequency = line / self._window_time
        if doubtful:
            return
        self._note_oscillation(step, found, residual)

    def _note_oscillation(self, step: int, found: bool, residual: NDArray[np.float64]) -> None:
        """A line must last longer than the window: a jump of the bias stays in the window only that long."""
        if found:
            self._oscillation_rest = 0
            self._evidence += 1
            if self._candidate is None:
                age = len(residual) - variance_change(residual)
                self._candidate = step - age * self._interval // PER_INTERVAL
            if self.oscillation is None and self._evidence >= self._persistence:
                self.oscillation = self._history.onset(self._candidate, self._axis)
            return
        self._oscillation_rest += 1
        if self._oscillation_rest > self._patience:
            self._evidence, self._candidate = 0, None
        if self._oscillation_rest > self._hold:
            self.oscillation = None

    def _highest_bin(self) -> int:
        """Upper end of the slow band, in periods per window."""
        highest = self._parameters.slow_frequency
        if self._source.kind != InputKind.NONE:
            highest = min(highest, self._source.frequency / self._parameters.period_ratio)
        if self._source.kind == InputKind.SINE and self._source.frequency > HIGHEST * 0.5 / self._sample_time:
            return 0  # near the Nyquist frequency the samples of the sine beat themselves
        return int(highest * self._window_time)

    def _is_oscillation(self, amplitude: float, share: float, highest: int) -> bool:
        """Fisher's test for a line in white noise, and the threshold in metres."""
        lines = highest - LOWEST_BIN + 1
        critical = 1.0 - (self._alarm_level / lines) ** (1.0 / (lines - 1))
        return amplitude >= self._parameters.oscillation_threshold and share >= critical

    def _repeats_with_input(self, line: float) -> bool:
        """Whether a line (periods per window) is a harmonic of a periodic input that is not a sine.

        Square waves have odd harmonics only; a bearing under a static load also responds with even ones.
        """
        period = repetition(self._front_end.reference[self._front_end.sources[self._axis]])
        if self._source.kind != InputKind.OTHER or period == 0:
            return False
        fundamental = len(self._residual) / period
        multiple = round(line / fundamental)
        return multiple > 0 and abs(line - multiple * fundamental) <= 1.0

    def _beating_orders(self) -> NDArray[np.int64]:
        """Harmonics of a sine above the Nyquist frequency that fold into the slow band somewhere in the window."""
        if self._source.kind != InputKind.SINE:
            return np.empty(0, np.int64)
        rate = 1.0 / self._sample_time
        frequency = self._front_end.frequency[self._front_end.sources[self._axis]]
        order = np.arange(2, self._parameters.beat_order + 1)
        low, high = order * frequency.min(), order * frequency.max()
        margin = ALIAS_MARGIN * self._parameters.slow_frequency
        nearest = np.round(0.5 * (low + high) / rate) * rate
        return order[(nearest > 0.0) & (low - margin <= nearest) & (nearest <= high + margin)]


def gain(response: float, amplitude: float) -> float:
    """Response per input; 0 without input."""
    return response / amplitude if amplitude > 0.0 and math.isfinite(response) else 0.0
