"""Persistence of excitation: the largest model that a signal determines, and whether the axes can be separated.

A periodic signal with n lines in its two-sided spectrum is persistently exciting of order n: a sine counts twice. A
line that is on both axes at once determines only one combination of them, so n such lines give each of two inputs n/2.
A model with n states needs order 2 n. The loop does not change this: the path from the reference to the control current
has no zero on the unit circle.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, section 13.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from amb_core.excitation import ExcitationSignal, Square
from amb_core.excitation.signal import excited_spans
from amb_core.excitation_design.content import line_spectrum, whole_periods

AUDIBLE = 0.01
"""Amplitude relative to the strongest line above which a line counts."""
ROUNDING = 1e-9
"""Amplitude over the peak of the signal below which a line is a rounding error: a constant has no lines."""


@dataclass(frozen=True)
class Persistence:
    """Persistence of excitation of a signal.

    Attributes
    ----------
    axes : tuple of str
        Axes that are excited.
    lines : tuple of int
        Lines with at least 1 % of the amplitude of the strongest, on each of them.
    order : int
        Order of persistent excitation on each of the axes, as they are excited; 0 where both carry the same signal.
    wanted : int
        Order that the model needs, twice its number of states.
    """

    axes: tuple[str, ...]
    lines: tuple[int, ...]
    order: int
    wanted: int

    @property
    def sufficient(self) -> bool:
        """Whether the signal determines the model."""
        return self.order >= self.wanted


def persistence(signal: ExcitationSignal, model_order: int) -> Persistence:
    """Persistence of excitation of a signal.

    Parameters
    ----------
    signal : ExcitationSignal
        The excitation.
    model_order : int
        Number of states of the model that is to be identified.
    """
    spans = excited_spans(signal.parameters.axes, signal.steps)
    audible = []
    for axis, first, last in spans:
        samples = signal.samples[first:last, axis]
        if isinstance(signal.parameters, Square):
            samples = whole_periods(samples, signal.parameters, signal.sample_time)
        amplitude = line_spectrum(samples, signal.sample_time)[1]
        peak = max(float(np.abs(samples).max(initial=0.0)), np.finfo(float).tiny)
        audible.append(amplitude >= max(AUDIBLE * amplitude.max(initial=0.0), ROUNDING * peak))
    order = 2 * min(int(lines.sum()) for lines in audible)
    if signal.parameters.axes == "both":
        same = np.array_equal(signal.samples[:, 0], signal.samples[:, 1])
        order = 0 if same else min(order, int((audible[0] | audible[1]).sum()))
    return Persistence(
        tuple("xy"[axis] for axis, _, _ in spans), tuple(int(lines.sum()) for lines in audible), order, 2 * model_order
    )
