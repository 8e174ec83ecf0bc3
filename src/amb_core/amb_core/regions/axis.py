"""One axis: evidence for regions B and C from its windows, and where each region begins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.bias_range import BiasRange
from amb_core.regions.front_end import FrontEnd
from amb_core.regions.history import InputHistory
from amb_core.regions.input_signal import InputKind
from amb_core.regions.judged import SearchedUpdates, TestedUpdates
from amb_core.regions.oscillation import SlowOscillation
from amb_core.regions.parameters import PER_INTERVAL, RegionParameters
from amb_core.regions.slow_reference import SlowReference
from amb_core.regions.slow_signal import HARMONICS, INAUDIBLE, TAPS, fit_window
from amb_core.regions.state import Onset
from amb_core.regions.steady_lines import SAME, SteadyLines, find_lines
from amb_core.regions.trend import FEWEST_POINTS, TrendTest

MOTION = 1e-6  # m: a decimated reference that moves more shows the static gain of the loop
HIGHEST_HARMONIC = 0.45  # of the decimated rate: decimation removes the harmonics above
STEADY_MARGIN = 1.3  # of the slow band: lines slightly outside the band leak into it
TURNING_HARMONICS = 3  # of the running speed, if it is known
MOVING = 0.5  # of `drift_threshold`: a reference that moves less makes no drift where the response is twice as large
MEANS = 8  # means of the bias, for its range, within the longest test
SMALLEST_STEADY = 0.1  # of `oscillation_threshold`: smaller lines have no effect


@dataclass
class Features:
    """What the windows of an axis show at one update; see `amb_core.regions.state.AxisState`."""

    bias: float = 0.0
    trend: float = 0.0
    trend_significance: float = 0.0


class AxisClassifier:
    """Regions B and C of one axis.

    Parameters
    ----------
    axis : int
        Its column in arrays of samples.
    parameters : RegionParameters
        Thresholds and times.
    front_end : FrontEnd
        Windows of all axes.
    history : InputHistory
        Inputs of the past, for the onsets.
    sample_time : float
        Controller sample time (s).
    interval : int
        Steps of an update interval.
    tested : TestedUpdates
        Counts the updates in which B is judged.
    searched : SearchedUpdates
        Counts those in which C is judged.

    Attributes
    ----------
    features : Features
        What the latest windows show.
    drift, oscillation : Onset or None
        Onsets of regions B and C while there is evidence for them.
    slow : SlowOscillation
        Evidence for region C.
    steady : SteadyLines
        Lines that were there before the excitation.
    fewest_updates : int
        Updates in which the shortest tests for B and for C are complete; before them neither could be found.
    """

    def __init__(
        self,
        axis: int,
        parameters: RegionParameters,
        front_end: FrontEnd,
        history: InputHistory,
        sample_time: float,
        interval: int,
        tested: TestedUpdates,
        searched: SearchedUpdates,
    ) -> None:
        self._axis = axis
        self._tested = tested
        self._parameters = parameters
        self._front_end = front_end
        self._history = history
        self._sample_time = sample_time
        self._interval = interval
        update = interval * sample_time
        samples = front_end.position.shape[1]
        self._rate = PER_INTERVAL / update
        self._hold = round(parameters.hold_time / update)
        points = max(round(parameters.trend_window / update), FEWEST_POINTS)
        self._trend = TrendTest(points, update, parameters.false_alarm_rate / 3600.0)
        self.slow = SlowOscillation(axis, parameters, front_end, sample_time, interval, searched)
        self.fewest_updates = max(self._trend.points, self.slow.fewest_updates)
        self.steady = SteadyLines(samples, PER_INTERVAL, self._rate)
        if parameters.running_speed:
            turning = parameters.running_speed / (2.0 * math.pi) * np.arange(1.0, TURNING_HARMONICS + 1.0)
            self.steady.expect(turning[turning <= STEADY_MARGIN * parameters.slow_frequency])
        self._was_slow: float | None = None  # Hz, of the latest oscillation
        self._unexplained, self._residual = np.empty((2, samples))
        self._range = BiasRange(self._trend.longest // MEANS)
        self._reference = SlowReference(samples + TAPS - 1, self._trend.longest)
        self.reset()

    def reset(self) -> None:
        """Forget evidence and regions, but not the steady lines: the loop is about to settle."""
        self._forget_bias()
        self.slow.reset()
        self._static_gain = 0.0
        self.features = Features()
        self.drift: Onset | None = None
        self.oscillation: Onset | None = None
        self._level = 0.0
        self._drift_rest = 0

    def _forget_bias(self) -> None:
        self._trend.reset()
        self._forget_range()
        self._reference.reset()

    def adopt_steady_lines(self, position: NDArray[np.float64], before: int, excited: bool) -> None:
        """Find the lines in decimated positions (m) without input, which ended `before` decimated samples ago.

        A line that was a slow oscillation before remains one. After an excitation (`excited`) a new line of the slow
        band is one too: it may have begun when the excitation stopped, while the loop settled and nothing was judged.
        """
        parameters = self._parameters
        frequency, amplitude = find_lines(
            position,
            self._rate,
            STEADY_MARGIN * parameters.slow_frequency,
            SMALLEST_STEADY * parameters.oscillation_threshold,
        )
        if self._was_slow is not None:
            other = np.abs(frequency - self._was_slow) * len(self._residual) / self._rate > SAME
            frequency, amplitude = frequency[other], amplitude[other]
        if excited:
            outside = frequency > parameters.slow_frequency
            frequency, amplitude = frequency[outside], amplitude[outside]
        self.steady.adopt(frequency, amplitude * np.exp(2j * math.pi * frequency * before / self._rate))

    @property
    def tests_drift(self) -> bool:
        """Whether a drift could have been found at the latest update: a test is complete, and none too slow for it."""
        return self._trend.complete and self._moved < self._parameters.drift_threshold

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
        amplitudes = self.steady.prior()
        gain = fit_window(
            front_end.position[axis],
            reference,
            phase,
            harmonics,
            linear,
            self.steady.columns(),
            amplitudes,
            self._unexplained,
            self._residual,
        )
        self.steady.correct(amplitudes, self._source.frequency, self._source.kind != InputKind.OTHER)
        self._reference.take(reference)
        if self._source.kind == InputKind.OTHER:
            self._take_out_static_response(reference, gain)
        self._judge_bias(step, len(self._unexplained) // PER_INTERVAL // 2)
        self.slow.update(self._unexplained, self._residual, step)
        self._note_oscillation()

    def _take_out_static_response(self, reference: NDArray[np.float64], gain: float) -> None:
        """Between the edges of a slow square wave, only the static gain separates the response from the bias."""
        middle = len(self._unexplained) // PER_INTERVAL // 2 * PER_INTERVAL
        past = reference[middle - 1 : middle + PER_INTERVAL + TAPS - 1]
        if np.ptp(past) > MOTION and not self._reference.smooth:
            if self._static_gain == 0.0:
                self._forget_bias()  # bias points so far contain the response to a constant reference
            self._static_gain = gain
        elif np.ptp(past) <= INAUDIBLE:
            part = slice(middle, middle + PER_INTERVAL)
            position = self._front_end.position[self._axis, part]
            self._unexplained[part] = position - self._static_gain * reference[middle + TAPS - 1]
            if self._static_gain != 0.0:
                self._reference.smooth = False  # its response is known

    def _note_oscillation(self) -> None:
        """Region C: the onset is looked up once, when the oscillation is found."""
        since = self.slow.since
        if since is None:
            self.oscillation = None
        elif self.oscillation is None:
            self.oscillation = self._history.onset(since, self._axis)
            self._was_slow = self.slow.frequency

    def conclude(self, step: int) -> None:
        """The rotor delevitated: also add the bias of the later half of the window, to find a drift that led to it."""
        for part in range(len(self._unexplained) // PER_INTERVAL // 2 + 1, len(self._unexplained) // PER_INTERVAL):
            self._judge_bias(step, part)

    def _judge_bias(self, step: int, part: int) -> None:
        """Region B: add the bias of one interval of the window."""
        parameters, features = self._parameters, self.features
        bias_step = step - len(self._unexplained) * self._interval // PER_INTERVAL + part * self._interval
        features.bias = float(np.mean(self._unexplained[part * PER_INTERVAL : (part + 1) * PER_INTERVAL]))
        resonant = self._history.resonant(bias_step, self._axis)
        moved = self._reference.moved(slice(part * PER_INTERVAL + TAPS - 1, (part + 1) * PER_INTERVAL + TAPS - 1))
        if resonant or moved > MOVING * parameters.drift_threshold:
            left_out = 1
            if self.drift is None:
                left_out += self._trend.incomplete
                self._trend.reset()
                self._forget_range()
                features.trend = features.trend_significance = 0.0
            self._tested.leave_out(left_out, resonant)
            return
        latest = self._trend.add(features.bias)
        self._tested.add(self._trend.count, self._trend.points)
        features.trend, features.trend_significance = latest.slope, latest.significance
        drifting = self._trend.drifting(parameters.drift_threshold)
        if drifting is not None and self.drift is None:
            points, self._level = self._trend.beginning(drifting)
            began = bias_step + self._interval // 2 - round(points * self._interval)
            self.drift = self._history.onset(began, self._axis)
        displaced = abs(features.bias - self._level) > parameters.drift_threshold
        self._drift_rest = 0 if drifting is not None or displaced else self._drift_rest + 1
        if self._drift_rest > self._hold:
            self.drift = None
        self._follow_range(features.bias)

    def _follow_range(self, bias: float) -> None:
        """Note how far the bias moves where nothing is found: several slow drifts, or one, may go far."""
        if self.drift is not None:
            self._tested.unnoticed = self._unnoticed  # what is noted since then is that drift
        if self.drift is not None or self.oscillation is not None:
            self._forget_range()
            return
        self._moved = self._range.add(bias)
        if self._moved >= self._parameters.drift_threshold:
            self._tested.unnoticed = max(self._tested.unnoticed, self._moved)

    def _forget_range(self) -> None:
        self._range.reset()
        self._moved = 0.0
        self._unnoticed: float = self._tested.unnoticed


def gain(response: float, amplitude: float) -> float:
    """Response per input; 0 without input."""
    return response / amplitude if amplitude > 0.0 and math.isfinite(response) else 0.0
