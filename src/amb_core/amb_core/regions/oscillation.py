"""Region C of one axis: a line in the slow band that persists, and is neither a beat nor a linear response.

The short window (`oscillation_window`) is searched from four periods a window upwards, long windows
(`amb_core.regions.long_windows`) below that, down to half a hertz.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.evidence import LineEvidence
from amb_core.regions.front_end import FrontEnd
from amb_core.regions.input_signal import HIGHEST, InputFeatures, InputKind
from amb_core.regions.linear_mode import unexplained_amplitude
from amb_core.regions.long_windows import LongWindow, LongWindows
from amb_core.regions.parameters import PER_INTERVAL, RegionParameters
from amb_core.regions.slow_signal import (
    line_table,
    remove_beats,
    repetition,
    slow_line,
    variance_change,
)

ALIAS_MARGIN = 1.3  # of the slow band: a beat is followed from slightly outside the band
LOWEST_BIN = 4  # periods per window: fewer cannot be distinguished from jumps of the bias
LINEAR = 0.5  # share of a line's amplitude that a linear mode may leave unexplained
SLOWEST_MODE = 8.0  # Hz: slower lines are not compared with a linear mode


class SlowOscillation:
    """Looks for a slow oscillation of one axis.

    Parameters
    ----------
    axis : int
        Its column in arrays of samples.
    parameters : RegionParameters
        Thresholds and times.
    front_end : FrontEnd
        Windows of all axes.
    sample_time : float
        Controller sample time (s).
    interval : int
        Steps of an update interval.

    Attributes
    ----------
    amplitude, frequency : float
        Largest line of the slow band that is not a beat (m, Hz).
    sampling_beat : bool
        Whether a harmonic of the input, folded at the sample rate, explains that line.
    since : int or None
        Step at which the oscillation set in; None without one.
    fewest_updates : int
        Updates in which a line of the short window becomes an oscillation.
    """

    def __init__(
        self, axis: int, parameters: RegionParameters, front_end: FrontEnd, sample_time: float, interval: int
    ) -> None:
        self._axis = axis
        self._parameters = parameters
        self._front_end = front_end
        self._sample_time = sample_time
        self._interval = interval
        update = interval * sample_time
        samples = front_end.position.shape[1]
        self._window_time = samples / PER_INTERVAL * update
        alarm_rate = parameters.false_alarm_rate / 3600.0
        self._alarm_level = alarm_rate * update
        # A jump of the bias stays in the window for the window's time.
        self._short = LineEvidence(
            samples // PER_INTERVAL + 3, samples // PER_INTERVAL // 4, round(parameters.hold_time / update)
        )
        self.fewest_updates = self._short.persistence
        self._long = LongWindows(
            LOWEST_BIN / self._window_time, update / PER_INTERVAL, alarm_rate, parameters.hold_time
        )
        self._table = line_table(samples, int(parameters.slow_frequency * self._window_time))
        self._cleaned = np.empty(samples)
        self.reset()

    def reset(self) -> None:
        """Forget everything: the loop is about to settle."""
        self._short.reset()
        self._long.reset()
        self.amplitude = self.frequency = 0.0
        self.sampling_beat = False

    @property
    def since(self) -> int | None:
        """Step at which the oscillation set in; None without one."""
        steps = [
            line.since for line in (self._short, *(window.evidence for window in self._long.windows)) if line.active
        ]
        return min((step for step in steps if step is not None), default=None)

    def update(self, unexplained: NDArray[np.float64], residual: NDArray[np.float64], step: int) -> None:
        """Evaluate the windows.

        Parameters
        ----------
        unexplained, residual : ndarray, shape (samples,)
            From `fit_window`, with and without the bias (m).
        step : int
            Of their latest decimated sample.
        """
        self._source = self._front_end.input_of(self._axis)
        self.amplitude = self.frequency = 0.0
        self.sampling_beat = False
        self._search_short(residual, step)
        self._search_long(unexplained, step)

    # -- the short window

    def _search_short(self, residual: NDArray[np.float64], step: int) -> None:
        """Look for a line that is not a beat.

        Beating may explain a part of the line, but less than `beat_share`, because the loop may respond to a beat in
        its own way. Such a window counts neither for nor against an oscillation: a real one outlasts the beat.
        """
        parameters = self._parameters
        doubtful = oscillates = False
        highest = self._highest_bin()
        if highest > LOWEST_BIN:
            amplitude, line, share, power = slow_line(residual, LOWEST_BIN, highest, self._table)
            loud = power >= 0.5 * parameters.oscillation_threshold**2
            orders = self._beating_orders() if loud else np.empty(0, np.int64)
            if len(orders):
                cleaned = self._cleaned
                source = self._front_end.sources[self._axis]
                remove_beats(residual, self._front_end.phase[source], orders, cleaned)
                amplitude, line, share, left = slow_line(cleaned, LOWEST_BIN, highest, self._table)
                explained = 1.0 - left / power
                self.sampling_beat = explained >= parameters.beat_share
                doubtful = explained >= 0.5 * parameters.beat_share
                residual = cleaned
            oscillates = not doubtful and self._is_oscillation(amplitude, share, highest)
            oscillates = oscillates and not self._repeats_with_input(line)
            self.amplitude, self.frequency = amplitude, line / self._window_time
        if doubtful:
            return
        if not oscillates:
            self._short.miss()
            return
        age = len(residual) - variance_change(residual) if self._short.since is None else 0
        self._short.find(self.amplitude, self.frequency, step - age * self._interval // PER_INTERVAL)
        self._decide(self._short)

    def _decide(self, evidence: LineEvidence) -> None:
        """A line that persists is an oscillation, unless it is the response of a linear mode."""
        if evidence.active or not evidence.suffices:
            return
        if self._is_linear(evidence.amplitude, evidence.frequency):
            evidence.withdraw()
        else:
            evidence.active = True

    def _is_linear(self, amplitude: float, frequency: float) -> bool:
        """Whether a linear mode leaves little of the line, or less than an oscillation that counts."""
        if frequency < SLOWEST_MODE:
            return False
        past = self._front_end.past
        reference = past.references()[:, self._front_end.sources[self._axis]]
        position = past.positions()[:, self._axis]
        rate = PER_INTERVAL / (self._interval * self._sample_time)
        resolution = 1.0 / self._window_time
        left = unexplained_amplitude(reference, position, frequency, resolution, rate)
        return left <= max(LINEAR * amplitude, self._parameters.oscillation_threshold)

    def _highest_bin(self) -> int:
        """Upper end of the slow band, in periods per window."""
        highest = self._parameters.slow_frequency
        if self._source.kind != InputKind.NONE:
            highest = min(highest, self._source.frequency / self._parameters.period_ratio)
        if self._beats_itself(self._source):
            return 0
        return int(highest * self._window_time)

    def _beats_itself(self, source: InputFeatures) -> bool:
        """Near the Nyquist frequency the samples of a sine beat themselves."""
        return source.kind == InputKind.SINE and source.frequency > HIGHEST * 0.5 / self._sample_time

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
        fundamental = self._front_end.position.shape[1] / period
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

    # -- the long windows

    def _search_long(self, unexplained: NDArray[np.float64], step: int) -> None:
        """Add the middle interval of the short window, where its fit is best, to the long ones."""
        middle = len(unexplained) // PER_INTERVAL // 2 * PER_INTERVAL
        part = slice(middle, middle + PER_INTERVAL)
        reference = self._front_end.reference[self._front_end.sources[self._axis]][-len(unexplained) :]
        frequency = math.inf if self._source.kind == InputKind.NONE else self._source.frequency
        samples = np.column_stack([unexplained[part], reference[part], np.full(PER_INTERVAL, frequency)])
        latest = step - (len(unexplained) - part.stop) * self._interval // PER_INTERVAL
        for window, ago in self._long.add(samples):
            self._test(window, latest - ago * self._interval // PER_INTERVAL)

    def _test(self, window: LongWindow, step: int) -> None:
        """Test a long window that ends at a step."""
        parameters = self._parameters
        sine = self._source.kind == InputKind.SINE
        if sine and (self._beats_itself(self._source) or window.beats(1.0 / self._sample_time, parameters.beat_order)):
            return  # counts neither for nor against an oscillation
        line = None
        if sine or not window.responds():
            highest = min(parameters.slow_frequency, window.lowest_input() / parameters.period_ratio)
            line = window.find(highest, parameters.oscillation_threshold)
        if line is None:
            window.evidence.miss()
            return
        window.evidence.find(line.amplitude, line.frequency, step - line.age * self._interval // PER_INTERVAL)
        self._decide(window.evidence)
        if line.amplitude > self.amplitude:
            self.amplitude, self.frequency = line.amplitude, line.frequency
