"""The swept sine by which a sensitivity is measured on a running loop: one over the band, then dwells at peaks.

The first sweep shows where narrow resonances are, and the highest sensitivity of each axis. At each the rotor is then
excited in a band of a few half bandwidths, for as long as its lines resolve the mode, and as weakly as its peak allows
to be known to 0.05 dB.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.excitation import Sweep
from amb_core.ground.errors import RobustnessError
from amb_core.ground.parameters import Parameters, quantity
from amb_core.linear import Arrays
from amb_core.loop.known_controller import KnownController
from amb_core.loop.linear_control import linear_law
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.measured import MeasuredSensitivity, experiments_of, measured_sensitivity, peaks
from amb_core.robustness.sharp_peaks import (
    LEAST_DAMPING,
    WIDEST,
    SharpMode,
    hidden_height,
    lowest_resolved,
    sharp_modes,
)

MATTERS = 0.1  # of T: up to the highest frequency with more a mode of ten times the response could spoil the loop
HIDDEN = 0.06  # of S: a narrow mode that changes it more is found, or the certificate names where it might not be
MOST_DWELLS = 6
_INSIDE = 2.0 ** (1.0 / 12.0)  # of the ends of an excitation, at which its response looks like a transient
_SPACING = 0.05  # relative, of the frequencies at which that is asked
_LINES = 4.0  # within the half bandwidth of a mode, of a dwell
_NARROW = 0.02  # damping ratio: broader modes are known from the first sweep
_WIDE = 6.0  # half bandwidths to either side of a dwell
_LONGEST = 10.0  # s, of a dwell on one axis
_KNOWN = 0.006  # relative, 0.05 dB: standard deviation of a peak after its dwell
_WEAKEST = 0.1  # of the amplitude of the sweep


class SweepSettings(Parameters):
    """A logarithmic sweep of each axis, one after the other. It dwells where loops are slow, at low frequencies."""

    sweep_amplitude: float = quantity(0.0, "m", "peak amplitude of the swept sine; 0: nothing is measured", 0.0, 1e-3)
    sweep_duration: float = quantity(20.0, "s", "duration of the swept sine, all axes together", 1.0, 600.0)
    sweep_start: float = quantity(3.0, "Hz", "frequency at which the swept sine starts", 0.1, 1_000.0)
    sweep_end: float = quantity(2_000.0, "Hz", "frequency at which the swept sine ends", 10.0, 50e3)

    @property
    def excitation(self) -> Sweep:
        """The excitation.

        Raises
        ------
        RobustnessError
            If there is no amplitude, or the frequency does not rise.
        """
        if not self.sweep_amplitude:
            raise RobustnessError("a swept sine needs an amplitude; give sweep_amplitude (m), such as 4um")
        if self.sweep_end <= self.sweep_start:
            raise RobustnessError(
                f"sweep_end = {self.sweep_end:g} Hz is not allowed; it must exceed sweep_start, {self.sweep_start:g} Hz"
            )
        return Sweep(
            amplitude=self.sweep_amplitude,
            duration=self.sweep_duration,
            frequency_start=self.sweep_start,
            frequency_end=self.sweep_end,
            spacing="logarithmic",
            axes="in_turn",
        )


def dwells(
    data: IdentificationData,
    controller: KnownController,
    settings: SweepSettings,
    modes: Sequence[SharpMode] | None = None,
) -> list[Sweep]:
    """Narrow sweeps at the resonances that a first sweep shows, the likeliest first, and at the highest S of each axis.

    Neither where it shows none, or knows the highest S to 0.05 dB. All stay in the band of the first.

    Parameters
    ----------
    data : IdentificationData
        Of the first sweep.
    controller : KnownController
        Of the loop.
    settings : SweepSettings
        Those of the first sweep.
    modes : sequence of SharpMode, optional
        What `modes_of` has found in the data; it takes some seconds.
    """
    known = modes_of(data, controller) if modes is None else modes
    inside = sorted((one for one in known if one.damping <= _NARROW), key=lambda one: -one.score)[:MOST_DWELLS]
    measured = measured_sensitivity(data, controller, inside)
    chosen = [*inside, *_highest_unknown(measured, inside)]
    return [
        _dwell(one, measured, settings, len(data.output_names))
        for one in chosen
        if settings.sweep_start < one.frequency < settings.sweep_end
    ]


def _highest_unknown(measured: MeasuredSensitivity, dwelt: Sequence[SharpMode]) -> list[SharpMode]:
    """The highest peak of S of each axis, as a mode as broad as any dwelt at, unless it is known or dwelt at anyway."""
    found: list[SharpMode] = []
    for axis in range(len(measured.axes)):
        tops = peaks(measured, axis)
        if not len(tops):
            continue
        at, top = float(measured.frequency[tops[-1]]), tops[-1]
        known = measured.deviation[top, axis] <= _KNOWN * abs(measured.own[top, axis])
        if not known and all(abs(at / one.frequency - 1.0) > _WIDE * one.damping for one in [*dwelt, *found]):
            found.append(SharpMode(at, _NARROW, 0.0))
    return found


def _dwell(mode: SharpMode, measured: MeasuredSensitivity, settings: SweepSettings, axes: int) -> Sweep:
    near = np.abs(measured.frequency / mode.frequency - 1.0) < 3.0 * mode.damping
    size, unknown = 1.0, 1.0
    if near.any():
        size = float(np.abs(measured.own[near]).max())
        unknown = float((measured.deviation[near] / np.abs(measured.own[near])).max())
    seconds = min(_LINES / (max(mode.damping, LEAST_DAMPING) * mode.frequency), _LONGEST)
    half = min(_WIDE * mode.damping, 0.5)
    # Power of the reference per line, over that of the first sweep: the deviation falls with its root.
    octave = math.log(settings.sweep_end / settings.sweep_start)
    denser = math.sqrt(seconds / (2.0 * half) * octave / (settings.sweep_duration / axes))
    needed, allowed = unknown / denser / _KNOWN, 1.0 / max(1.0, size)  # the rotor moves no more than without a peak
    longer = min(max((needed / allowed) ** 2, 1.0), _LONGEST / seconds)
    weaker = min(needed / math.sqrt(longer), allowed)
    return Sweep(
        amplitude=settings.sweep_amplitude * max(weaker, _WEAKEST),
        duration=axes * seconds * longer,
        frequency_start=max(mode.frequency * (1.0 - half), settings.sweep_start),
        frequency_end=min(mode.frequency * (1.0 + half), settings.sweep_end),
        axes="in_turn",
    )


def modes_of(data: IdentificationData, law: KnownController) -> list[SharpMode]:
    """The narrow resonances that data with a reference show, in their band, and that change the sensitivity enough."""
    low, high = looked_band(data, WIDEST)
    modes = [one for one in sharp_modes(experiments_of(data), data.sample_time) if low <= one.frequency <= high]
    shown = _shown(data, law, np.array([one.frequency for one in modes]))
    return [one for one, share in zip(modes, shown, strict=True) if one.height * share >= 0.5 * HIDDEN]


def sweep_remarks(data: IdentificationData, feedback: Feedback, law: KnownController) -> tuple[str, ...]:
    """What a sweep leaves open: modes of the least damping that it passes too fast, and where it ends too early."""
    references = [item.reference for item in data.experiments if item.reference is not None]
    if not references:
        return ()
    first = _INSIDE * _ends(references, data.sample_time)[0]
    low, last = looked_band(data)
    remarks = []
    if low > first:
        remarks.append(
            f"the swept sine passes modes of damping {LEAST_DAMPING:g} too fast below {min(low, last):.4g} Hz: it "
            f"would have to last {low / first:.3g} times as long to show them from {first:.4g} Hz onwards"
        )
    at = low * np.exp(np.arange(0.0, math.log(max(last / low, 1.0)), _SPACING))
    height = hidden_in_sensitivity(data, law, at, LEAST_DAMPING)
    quiet = at[height > HIDDEN]
    if len(quiet):
        remarks.append(
            f"at {len(quiet)} of {len(at)} frequencies looked at, from {quiet[0]:.4g} to {quiet[-1]:.4g} Hz, a mode of "
            f"damping {LEAST_DAMPING:g} that changes the sensitivity by {HIDDEN:g} could hide in the noise of the "
            "swept sine; a larger amplitude or a longer sweep shows it"
        )
    matters = highest_that_matters(feedback)
    if last < matters:
        remarks.append(
            f"the swept sine shows narrow modes up to {last:.4g} Hz; the loop acts up to {matters:.4g} Hz, and nothing "
            "was looked for between them"
        )
    return tuple(remarks)


def hidden_in_sensitivity(data: IdentificationData, law: KnownController, frequency: Arrays, damping: float) -> Arrays:
    """How much of the sensitivity a mode of a damping ratio may change without being found, shape (f,).

    References act on the rotor through another part of a controller than positions do, if it derives the position: then
    they show less of the loop.
    """
    return hidden_height(experiments_of(data), data.sample_time, frequency, damping) * _shown(data, law, frequency)


def _shown(data: IdentificationData, law: KnownController, frequency: Arrays) -> Arrays:
    """Change of S over that of the response of the outputs to the references, shape (f,)."""
    axes = len(data.output_names)
    response = np.abs(linear_law(law.at_rate(data.sample_rate), axes).response(frequency))
    own = np.diagonal(response[:, :, axes:], axis1=1, axis2=2) / np.diagonal(response[:, :, :axes], axis1=1, axis2=2)
    return np.asarray(own.max(axis=1))


def looked_band(data: IdentificationData, damping: float = LEAST_DAMPING) -> tuple[float, float]:
    """Frequencies (Hz) between which data show modes of a damping ratio: slow enough, and excited."""
    references = [item.reference for item in data.experiments if item.reference is not None]
    first, last = _ends(references, data.sample_time)
    return max(_INSIDE * first, lowest_resolved(experiments_of(data), data.sample_time, damping)), last / _INSIDE


def highest_that_matters(feedback: Feedback) -> float:
    """The highest frequency (Hz) at which the complementary sensitivity of a loop is a tenth or more."""
    half = 0.5 / feedback.plant.sample_time
    frequency = np.geomspace(1e-4 * half, half, 400)
    size = np.linalg.norm(feedback.complementary.response(frequency), 2, axis=(1, 2))
    acts = np.flatnonzero(size >= MATTERS)
    return float(frequency[acts[-1]]) if len(acts) else 0.0


def _ends(references: list[np.ndarray], sample_time: float) -> tuple[float, float]:
    """Lowest and highest frequency (Hz) that references excite: much of the most per octave, or of the most per line.

    The first is even in a logarithmic sweep, the second in a linear one and in a multisine.
    """
    low, high = math.inf, 0.0
    for reference in references:
        lines = np.sum(np.abs(np.fft.rfft(reference - reference.mean(axis=0), axis=0)[1:]) ** 2, axis=1)
        frequency = np.fft.rfftfreq(len(reference), sample_time)[1:]
        part = np.floor(12.0 * np.log2(frequency / frequency[0])).astype(int)
        power = np.bincount(part, lines)
        per_line = power / np.maximum(np.bincount(part), 1)
        much = (power > 0.25 * power.max()) | (per_line > 0.5 * per_line.max())
        excited = frequency[much[part]]
        low, high = min(low, float(excited[0])), max(high, float(excited[-1]))
    return low, high
