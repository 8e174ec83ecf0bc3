"""Region C of one axis: a line in the slow band that persists, and is neither a beat nor a linear response.

The short window (`oscillation_window`) is searched from four periods a window upwards, long windows
(`amb_core.regions.long_windows`) below that, down to half a hertz.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.evidence import LineEvidence
from amb_core.regions.front_end import FrontEnd
from amb_core.regions.input_signal import HIGHEST, InputFeatures, InputKind
from amb_core.regions.judged import OtherCause, SearchedUpdates
from amb_core.regions.linear_mode import unexplained_amplitude
from amb_core.regions.long_windows import LongWindow, LongWindows
from amb_core.regions.parameters import PER_INTERVAL, RegionParameters
from amb_core.regions.several_lines import critical_share, critical_shares, lines_explain
from amb_core.regions.slow_signal import (
    CONSTANT,
    ENVELOPE,
    line_table,
    remove_beats,
    repetition,
    slow_line,
    variance_change,
)

ALIAS_MARGIN = 1.3  # of the slow band: a beat is followed from slightly outside the band
LOWEST_BIN = 4  # periods per window: fewer cannot be distinguished from jumps of the bias
LINEAR = 0.5  # share of a line's amplitude that a linear mode may leave unexplained
LEAKING = 0.1  # amplitude of a line over the motion of the bias in the window, below which lines may belong to that
STEADY_PERIODS = 0.1  # periods per window that the highest beat may shift while the input counts as steady
STEADY_AMPLITUDE = 0.05  # of the input, by which it may change meanwhile
SLOWEST_MODE = 8.0  # Hz: slower lines are not compared with a linear mode


class ShortLine(NamedTuple):
    """Largest line of the short window: amplitude (m), bin, share of the power of the band, and that power (m^2)."""

    amplitude: float
    bin: float
    share: float
    power: float


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
    searched : SearchedUpdates
        Counts the updates in which C is judged.

    Attributes
    ----------
    amplitude, frequency : float
        Largest line of the slow band that is not a beat (m, Hz).
    sampling_beat : bool
        Whether a harmonic of the input, folded at the sample rate, explains that line.
    cause : OtherCause or None
        What else a slow line may be; None without one, and where an oscillation was found.
    since : int or None
        Step at which the oscillation set in; None without one.
    fewest_updates : int
        Updates in which a line of the short window becomes an oscillation.
    """

    def __init__(
        self,
        axis: int,
        parameters: RegionParameters,
        front_end: FrontEnd,
        sample_time: float,
        interval: int,
        searched: SearchedUpdates,
    ) -> None:
        self._axis = axis
        self._searched = searched
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
        self._bins = int(parameters.slow_frequency * self._window_time)
        self._table = line_table(samples, self._bins)
        self._cleaned = np.empty(samples)
        self.reset()

    def reset(self) -> None:
        """Forget everything: the loop is about to settle."""
        self._short.reset()
        self._long.reset()
        self.amplitude = self.frequency = 0.0
        self.sampling_beat = False
        self.cause: OtherCause | None = None

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
        self._bias_motion = float(np.ptp(unexplained - residual))
        short = self._search_short(residual, step)
        self._search_long(unexplained, step)
        causes = [short, *(window.cause for window in self._long.windows)]
        self.cause = None if self.since is not None else next(filter(None, causes), None)
        self._searched.add(self.cause)

    # -- the short window

    def _search_short(self, residual: NDArray[np.float64], step: int) -> OtherCause | None:
        """Look for a line that is not a beat; returns what else a line may be.

        Beating may explain a part of the line, but less than `beat_share`, because the loop may respond to a beat in
        its own way. Such a window counts neither for nor against an oscillation: a real one outlasts the beat.
        """
        parameters = self._parameters
        oscillates = False
        highest = self._highest_bin()
        if highest > LOWEST_BIN:
            line = self._largest_line(residual, highest)
            beats = self._beats_itself(self._source) and line.amplitude >= parameters.oscillation_threshold
            orders = self._beating_orders()
            if line.power >= 0.5 * parameters.oscillation_threshold**2 and len(orders):
                residual, explained = self._without_beats(residual, orders, highest)
                line = self._largest_line(residual, highest)
                self.sampling_beat = explained >= parameters.beat_share
                beats = explained >= 0.5 * parameters.beat_share
            self.amplitude, self.frequency = line.amplitude, line.bin / self._window_time
            if beats:
                return OtherCause.BEAT
            oscillates = self._is_oscillation(residual, line, highest)
        if not oscillates:
            self._short.miss()
            return OtherCause.RESPONSE if self._moves_as_fast(residual, highest) else None
        age = len(residual) - variance_change(residual) if self._short.since is None else 0
        self._short.find(self.amplitude, self.frequency, step - age * self._interval // PER_INTERVAL)
        self._decide(self._short)
        return None

    def _largest_line(self, residual: NDArray[np.float64], highest: int) -> ShortLine:
        return ShortLine(*slow_line(residual, LOWEST_BIN, highest, self._table))

    def _without_beats(
        self, residual: NDArray[np.float64], orders: NDArray[np.int64], highest: int
    ) -> tuple[NDArray[np.float64], float]:
        """A residual without beats, and the share of the power in the slow band that they explain.

        Beats whose amplitude may change over the window explain slow lines beside them, too. Where nothing else
        changes, theirs does not either: if beats of constant amplitude leave an oscillation, it is one.
        """
        parameters = self._parameters
        power = self._largest_line(residual, highest).power
        phase = self._front_end.phase[self._front_end.sources[self._axis]]
        remove_beats(residual, phase, orders, ENVELOPE, self._cleaned)
        explained = 1.0 - self._largest_line(self._cleaned, highest).power / power
        doubtful = 0.5 * parameters.beat_share
        if explained >= doubtful and self._input_is_steady() and self._bias_motion < parameters.drift_threshold:
            steady = np.empty_like(residual)
            remove_beats(residual, phase, orders, CONSTANT, steady)
            line = self._largest_line(steady, highest)
            if 1.0 - line.power / power < doubtful and self._is_oscillation(steady, line, highest):
                return steady, 1.0 - line.power / power
        return self._cleaned, explained

    def _input_is_steady(self) -> bool:
        """Whether there is no input, or a sine whose frequency and amplitude hardly change over the window."""
        if self._source.kind != InputKind.SINE:
            return self._source.kind == InputKind.NONE
        source = self._front_end.sources[self._axis]
        amplitude, frequency = self._front_end.amplitude[source], self._front_end.frequency[source]
        shift = self._parameters.beat_order * float(np.ptp(frequency)) * self._window_time
        return shift < STEADY_PERIODS and float(np.ptp(amplitude)) < STEADY_AMPLITUDE * float(amplitude.max())

    def _moves_as_fast(self, residual: NDArray[np.float64], highest: int) -> bool:
        """Whether a line stands out in the slow band that is not much slower than an input that is no sine.

        The frequency of such an input is a mean: parts of it are faster, and the line may be an oscillation.
        """
        whole = self._bins
        if self._source.kind != InputKind.OTHER or highest >= whole:
            return False
        return self._is_oscillation(residual, self._largest_line(residual, whole), whole)

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
        return int(highest * self._window_time)

    def _may_beat(self, window: LongWindow) -> bool:
        """Whether a line of a long window may be a beat of the sine."""
        return self._beats_itself(self._source) or window.beats(1.0 / self._sample_time, self._parameters.beat_order)

    def _beats_itself(self, source: InputFeatures) -> bool:
        """Near the Nyquist frequency the samples of a sine beat themselves."""
        return source.kind == InputKind.SINE and source.frequency > HIGHEST * 0.5 / self._sample_time

    def _is_oscillation(self, residual: NDArray[np.float64], line: ShortLine, highest: int) -> bool:
        """Whether the largest line of a residual counts: large enough, significant, and no multiple of the input."""
        if line.amplitude < self._parameters.oscillation_threshold or self._repeats_with_input(line.bin):
            return False
        return self._is_significant(residual, line, highest)

    def _is_significant(self, residual: NDArray[np.float64], line: ShortLine, highest: int) -> bool:
        """Fisher's test for a line in white noise; if it fails, the same for several lines, between bins too."""
        bins = highest - LOWEST_BIN + 1
        if line.share >= critical_share(bins, 1, self._alarm_level):
            return True
        if line.amplitude < LEAKING * self._bias_motion:
            return False  # what a parabola leaves of a swing below the band has several lines, too
        shares = critical_shares(bins, self._alarm_level)
        if not self._input_is_steady():
            shares = shares[:1]  # the beats of a sweep pass through the band, which several lines would explain
        return lines_explain(residual, LOWEST_BIN, highest, self._table, shares)

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
        if self._source.kind != InputKind.SINE or self._beats_itself(self._source):  # without a phase
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
        responds = not sine and window.responds()
        highest = parameters.slow_frequency
        if not responds:
            highest = min(highest, window.lowest_input() / parameters.period_ratio)
        line = window.find(highest, parameters.oscillation_threshold)
        window.cause = None
        if line is not None and sine and self._may_beat(window):
            window.cause = OtherCause.BEAT
            return  # counts neither for nor against an oscillation
        if line is None or not line.significant:
            window.evidence.miss()
            return
        if responds:
            window.cause = OtherCause.RESPONSE
            window.evidence.miss()
            return
        window.evidence.find(line.amplitude, line.frequency, step - line.age * self._interval // PER_INTERVAL)
        self._decide(window.evidence)
        if line.amplitude > self.amplitude:
            self.amplitude, self.frequency = line.amplitude, line.frequency
