"""Removes drift from data: steps of the sensors are subtracted, slow drift by a high-pass prefilter.

A state for the drift that walks at random, estimated along, amounts to a high-pass filter of all signals as well: what
the filter of that state takes for drift is the slow part of the errors. Here one window length is chosen for all
signals instead of a covariance for each output, and no method needs to know of it. The data choose it: least entropy of
the ARX model's innovations, less what the filter takes from every spectrum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import linalg

from amb_core.data.experiments.dataset import IdentificationData, require_data
from amb_core.data.experiments.drift.autoregression import LAGS, fit, scales
from amb_core.data.experiments.drift.find import Drift, find_drift, long_enough, undrifted
from amb_core.data.experiments.drift.prefilter import CORNER, high_pass, log_gain
from amb_core.data.experiments.drift.steps import SensorStep, find_steps, without_steps
from amb_core.linear.numerics import one_blas_thread

DriftOption = Literal["auto", "none", "prefilter"]

_SHARES = (16, 32, 64, 128)  # parts of the shortest experiment that a window may take; a longer one loses much data
_SHORTEST_WINDOW = 5 * LAGS


@dataclass(frozen=True)
class DriftCure:
    """What was removed from data.

    Attributes
    ----------
    data : IdentificationData
        The data without drift. Experiments too short for the prefilter are left out.
    steps : tuple of SensorStep
        The subtracted steps of the outputs.
    window : int
        Samples of the prefilter's moving average.
    drift : Drift or None
        The evidence; None where it was not looked for.
    """

    data: IdentificationData
    steps: tuple[SensorStep, ...]
    window: int
    drift: Drift | None

    @property
    def corner(self) -> float:
        """Frequency at which the prefilter passes half the amplitude (Hz)."""
        return CORNER / (self.window * self.data.sample_time)

    @property
    def summary(self) -> str:
        """What was done, as a phrase."""
        parts = []
        if self.steps:
            at = ", ".join(str(step.step) for step in self.steps[:3]) + (" ..." if len(self.steps) > 3 else "")
            parts.append(f"steps of the outputs subtracted (at step {at})")
        parts.append(f"high-pass prefilter of {self.corner:.3g} Hz on inputs and outputs")
        return "drift removed: " + ", ".join(parts)


def cure_drift(data: IdentificationData, option: DriftOption = "auto") -> DriftCure | None:
    """Remove steps and slow drift of the outputs; None if there is nothing to remove.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    option : str, optional
        `auto` where there is drift; `none` never; `prefilter` always, as far as the samples suffice.

    Returns
    -------
    DriftCure or None
        The data without drift, and what was removed; None if nothing was.
    """
    require_data(data)
    if option == "none":
        return None
    drift = find_drift(data)
    kept = long_enough(data)
    if kept is None or (option == "auto" and (drift is None or not drift.found)):
        return None
    model = undrifted(kept)
    steps = [] if model is None else find_steps(kept, model)
    level = without_steps(kept, steps)
    window = _best_window(level)
    return DriftCure(high_pass(level, window), tuple(steps), window, drift)


def _best_window(data: IdentificationData) -> int:
    """The window with the least entropy of the innovations."""
    shortest = min(item.steps for item in data.experiments)
    windows = [length for share in _SHARES if (length := shortest // share | 1) >= _SHORTEST_WINDOW]
    windows = windows or [_SHORTEST_WINDOW | 1]
    return min(windows, key=lambda window: _entropy(data, window, windows[0]))


def _entropy(data: IdentificationData, window: int, longest: int) -> float:
    """Logarithm of the determinant of the innovations' covariance, for samples that the longest window leaves."""
    factor, p = scales(data), len(data.output_names)
    filtered = high_pass(data, window)
    parts = []
    for item, original in zip(filtered.experiments, data.experiments, strict=True):
        common = item.window(original.first_step + longest // 2, original.stop - longest // 2)
        signals = np.hstack([common.inputs, common.outputs]) / factor
        parts.append(signals - signals.mean(axis=0))
    try:
        with one_blas_thread():
            covariance = fit(parts, p).covariance
    except linalg.LinAlgError:
        return math.inf
    return float(np.linalg.slogdet(covariance)[1]) - p * log_gain(window)
