"""The frequencies at which data say enough of a plant for its loop, and what is assumed beyond them.

With the error D of the response the loop stays stable if it is stable without, D is stable and, at every frequency,

    ||D C S|| < 1                                                                           (small gain).

Data count where what they leave open of D uses up less than a share of this. From where the sensitivity peaks the known
band reaches to the first frequency below and above at which they do not.

Above it the response is that of a mass, continued from the last octave, and modes of a gain up to g relative to it and
a damping ratio from zeta: ||P|| <= (1 + g / (2 zeta)) mass / f^2. If the small gain holds for all these plants, the
loop is known as a whole; otherwise, and where they leave its sensitivity beyond its zone (`assess_known`), nothing is
stated above, nor on stability. Below the band the error is taken as large as at its lower end, or as the data leave it
open where a loop sees less of that, if that end lies well below the peak of the sensitivity and noise, which moves the
rotor at all frequencies, shows no slow modes that the model lacks. Otherwise the error is that of the slow modes which
the data leave open, of the same gain and ringing down as assumed, and the small gain has to hold with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from amb_core.linear import Arrays, Complexes
from amb_core.robustness.error_band import ErrorBand
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.settings import RobustnessSettings

OPEN_BELOW, OPEN_ABOVE = 0.25, 0.5
"""Of the small gain, what the data may leave open below and above the peak of the sensitivity: below, the loop acts on
errors most and they widen its bound."""
_SLOWEST = 0.1  # of the lower end of the band: slower modes ring down as fast, so they are damped more
BELOW = 0.5  # of the frequency at which the sensitivity peaks, where the band has to start


@dataclass(frozen=True, eq=False)
class KnownBand:
    """What is known of a loop by frequency.

    Attributes
    ----------
    low, high : float
        The band (Hz) in which the data say enough; NaN if there is none.
    reaches_down, reaches_up : bool
        Whether the assumptions cover what lies below it and above it.
    noise_explained : bool
        Whether the residuals show no dynamics that the model lacks.
    slower : float
        Largest ||D C S|| below it of modes under the assumptions, or of what the data leave open where that is less;
        below 1 they keep the loop stable.
    beyond : float
        Largest ||D C S|| above it under the assumptions; below 1 they keep the loop stable.
    band : ErrorBand or None
        What the data show and leave open of D C S.
    mass : float
        ||P|| f^2 above the band (m Hz^2/A).
    settings : RobustnessSettings
        The assumptions.
    """

    low: float
    high: float
    reaches_down: bool
    reaches_up: bool
    noise_explained: bool
    slower: float
    beyond: float
    band: ErrorBand | None
    mass: float
    settings: RobustnessSettings

    @property
    def whole(self) -> bool:
        """Whether something is known at every frequency."""
        return self.reaches_down and self.reaches_up

    @property
    def empty(self) -> bool:
        """Whether nothing is known at any frequency."""
        return math.isnan(self.low)

    @property
    def text(self) -> str:
        """The band in words."""
        return "at no frequency" if self.empty else f"from {self.low:.3g} to {self.high:.4g} Hz"

    def holds(self, frequency: Arrays) -> Arrays:
        """Frequencies of which something is stated, as booleans."""
        above_low = (frequency >= self.low) | self.reaches_down
        below_high = (frequency <= self.high) | self.reaches_up
        return np.asarray(above_low & below_high & (not self.empty))

    def error(self, feedback: Feedback, frequency: Arrays) -> tuple[Arrays, Complexes]:
        """Size of D N at frequencies of which something is stated, shape (f,), and N, shape (f, m, m).

        N is C S in the band and below it, so the size has no unit; above it is 1 (m/A).
        """
        assert self.band is not None
        below, above = frequency < self.low, frequency > self.high
        inside = np.clip(frequency, self.low, self.high)
        error, action = self.band.within(inside)[1], feedback.action(inside)
        error[below], action[below] = self._below(feedback, frequency[below], error[below], action[below])
        action[above] = np.eye(feedback.inputs)
        if np.any(above):
            size = np.linalg.norm(feedback.plant.response(frequency[above]), 2, axis=(1, 2))
            error[above] = np.maximum(self._at_end(feedback), size + self._of_class(frequency[above]))
        return error, action

    def _below(
        self, feedback: Feedback, frequency: Arrays, error: Arrays, action: Complexes
    ) -> tuple[Arrays, Complexes]:
        """The same below the band, from those of its lower end.

        Where noise shows no slow modes, they are those of the lower end, or what the data leave open where a loop sees
        less of it. Otherwise they are those of slow modes.
        """
        assert self.band is not None
        slow = np.append(frequency, self.low)  # what lies next to the band belongs to the last below it
        own = feedback.action(frequency)
        if not self.noise_explained:
            return _of_slow_modes(feedback, slow, self.band, self.settings)[:-1], own
        of_data = _of_data(self.band, slow)[:-1]
        of_end = error * np.linalg.norm(np.linalg.pinv(action) @ own, 2, axis=(1, 2))
        known = of_data < of_end
        return np.where(known, of_data, error), np.where(known[:, np.newaxis, np.newaxis], own, action)

    def _at_end(self, feedback: Feedback) -> float:
        """Size of D at the upper end of the band (m/A)."""
        end = np.array([self.high])
        assert self.band is not None
        return float(self.band.within(end)[1][0] / np.linalg.norm(feedback.action(end)[0], -2))

    def _of_class(self, frequency: Arrays) -> Arrays:
        modes = self.settings.mode_gain / (2.0 * self.settings.mode_damping)
        return np.asarray((1.0 + modes) * self.mass / frequency**2)


def known_band(
    feedback: Feedback, band: ErrorBand | None, settings: RobustnessSettings, noise_explained: bool = True
) -> KnownBand:
    """What the error band of a loop makes known of it.

    Parameters
    ----------
    feedback : Feedback
        The loop, stable.
    band : ErrorBand or None
        Of the model's error, times the action of this loop; nothing is known without.
    settings : RobustnessSettings
        What is assumed beyond it.
    noise_explained : bool
        Whether the residuals show no dynamics that the model lacks.
    """
    nothing = KnownBand(math.nan, math.nan, False, False, noise_explained, math.inf, math.inf, band, math.nan, settings)
    if band is None:
        return nothing
    m, frequency = feedback.inputs, band.frequency
    closed = feedback.closed.response(frequency)
    peak = int(np.argmax(np.linalg.norm(closed[:, m:, m:], 2, axis=(1, 2))))
    allowed = np.where(np.arange(len(frequency)) < peak, OPEN_BELOW, OPEN_ABOVE)
    unknown = np.flatnonzero(~(band.open < allowed))
    if peak in unknown:
        return nothing
    below, above = unknown[unknown < peak], unknown[unknown > peak]
    first = int(below[-1]) + 1 if len(below) else 0
    last = int(above[0]) - 1 if len(above) else len(frequency) - 1
    low, high = float(frequency[first]), float(frequency[last])
    octave = np.geomspace(max(low, 0.5 * high), high, 50)
    mass = float(np.median(np.linalg.norm(feedback.plant.response(octave), 2, axis=(1, 2)) * octave**2))
    slow = np.geomspace(_SLOWEST * low, low, 100)
    slower = float(np.max(_of_slow_modes(feedback, slow, band, settings)))
    reaches_down = low <= BELOW * float(frequency[peak]) and (noise_explained or slower < 1.0)
    known = KnownBand(low, high, reaches_down, True, noise_explained, slower, 0.0, band, mass, settings)
    rest = np.geomspace(high, 0.5 / feedback.plant.sample_time, 500)[1:]
    by_action = np.linalg.norm(feedback.action(rest), 2, axis=(1, 2))
    beyond = float(np.max(by_action * known.error(feedback, rest)[0]))
    return replace(known, reaches_up=beyond < 1.0, beyond=beyond)


def _of_slow_modes(feedback: Feedback, frequency: Arrays, band: ErrorBand, settings: RobustnessSettings) -> Arrays:
    """||D C S|| of modes of the assumed gain relative to the rotor's own motion, or of what the data leave open."""
    damping = np.maximum(settings.mode_damping, 1.0 / (2.0 * np.pi * frequency * settings.mode_ring_down))
    motion = np.linalg.norm(feedback.plant.response(frequency), 2, axis=(1, 2))
    action = np.linalg.norm(feedback.action(frequency), 2, axis=(1, 2))
    assumed = settings.mode_gain / (2.0 * damping) * motion * action
    return np.asarray(np.minimum(assumed, _of_data(band, frequency)))


def _of_data(band: ErrorBand, frequency: Arrays) -> Arrays:
    """||D C S|| that the data show and leave open; infinite below the first frequency of which they say something."""
    return np.where(frequency < band.frequency[0], math.inf, band.within(frequency)[1])
