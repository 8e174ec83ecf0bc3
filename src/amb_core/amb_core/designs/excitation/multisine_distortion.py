"""Nonlinear distortion that a multisine causes, measured by random-phase multisines of the same band and power.

A recording of one signal does not separate distortions of even and odd order. Multisines with detection lines do
(`amb_core.regions.distortion`). They have the band and the rms of the designed signal, but random phases: their slow
changes of power excite more distortion of even order than a signal of low crest factor does.
"""

from __future__ import annotations

import math

import numpy as np

from amb_core.designs.excitation.linear_response import LinearLoop
from amb_core.designs.excitation.spans import spans_on_one_bearing
from amb_core.excitation import ExcitationSignal, Multisine
from amb_core.regions.distortion import DistortionSettings
from amb_core.regions.distortion.signals import EXPERIMENTS, lines_of, reference_of

_PERIOD = 0.25  # s, longer than the loop needs to settle; used if the band then has enough lines
_REST = 0.3  # s, before the excitation
_FEWEST_LINES = 64  # odd and even ones in the band
_LARGEST_SEED = 2**31
CANDIDATES = 100
"""Realisations of the class of which those that request most of the amplifiers are simulated."""


def distortion_settings(signal: ExcitationSignal, realisations: int) -> DistortionSettings:
    """Settings of a measurement with the band, the power and the axes of a multisine.

    Parameters
    ----------
    signal : ExcitationSignal
        The multisine.
    realisations : int
        Number of realisations of the random phases.
    """
    parameters = signal.parameters
    assert isinstance(parameters, Multisine)
    band = parameters.frequency_end - parameters.frequency_start
    rate = 1.0 / signal.sample_time
    # Below half the sample rate, where a line has no phase
    end = min(parameters.frequency_end, 0.499 * rate)
    period = math.ceil(max(_PERIOD, _FEWEST_LINES / band) * rate) / rate
    spans = spans_on_one_bearing(signal)
    rms = max(float(np.sqrt(np.mean(signal.samples[first:last, axis] ** 2))) for axis, first, last in spans)
    at_once = len(spans) == 2 and spans[0][1:] == spans[1][1:]
    return DistortionSettings(
        rms=rms,
        frequency_start=parameters.frequency_start,
        frequency_end=end,
        period=period,
        realisations=realisations,
        seed=parameters.seed % _LARGEST_SEED,
        rest=_REST,
        axes="both" if at_once else "in_turn",
    )


def most_demanding(settings: DistortionSettings, loop: LinearLoop, sample_rate: float) -> list[int]:
    """Numbers of the realisations of `CANDIDATES` with the highest peaks, half of current and half of its slew.

    The peaks are those that the linearised loop requests: they decide which realisations clip. Of any share of the
    class above 3 % at least one is among the candidates, with a probability of 95 %.
    """
    lines = lines_of(settings, sample_rate)
    peaks = np.zeros((CANDIDATES, 2))
    for number in range(CANDIDATES):
        for experiment in range(len(EXPERIMENTS[settings.axes])):
            period = reference_of(settings, lines, number, experiment)
            current = loop.respond(np.tile(period, (2, 1))).current[-lines.steps :]
            highest = np.abs(current).max(), np.abs(np.diff(current, axis=0)).max()
            peaks[number] = np.maximum(peaks[number], highest)
    by_current, by_slew = np.argsort(-peaks, axis=0).T
    chosen = dict.fromkeys(int(number) for pair in zip(by_current, by_slew, strict=True) for number in pair)
    return list(chosen)[: settings.realisations]
