"""Nonlinear distortion that a multisine causes, measured by random-phase multisines of the same band and power.

A recording of one signal does not separate distortions of even and odd order. Multisines with detection lines do
(`amb_core.distortion`). They have the band and the rms of the designed signal, but random phases: their slow changes
of power excite more distortion of even order than a signal of low crest factor does.
"""

from __future__ import annotations

import math

import numpy as np

from amb_core.distortion import DistortionSettings
from amb_core.excitation import ExcitationSignal, Multisine
from amb_core.excitation_design.spans import spans_on_one_bearing

_PERIOD = 0.25  # s, longer than the loop needs to settle; used if the band then has enough lines
_REST = 0.3  # s, before the excitation
_FEWEST_LINES = 64  # odd and even ones in the band
_LARGEST_SEED = 2**31


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
