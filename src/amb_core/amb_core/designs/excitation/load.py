"""The load that an excitation puts on the bearing, in terms of a region map: 1 where a region begins.

Regions B to D come from the mean square of the control current (the flux squared shifts the bias and adds to the
negative stiffness) and from the share of time in which it is clipped. Both are of second order: sines of different
frequencies add by their squares. I_k is the amplitude of the control current at the frequency f_k, and I_R(f) the one
at which a single sine enters region R. Then the load towards R is sqrt(sum_k (I_k / I_R(f_k))^2). For a single sine
that is the map itself.

The sum is taken over a quarter of a second at a time, and the largest one counts, since the bias follows within about
10 ms. So a signal with low frequencies first and high ones later (a multisine with Schroeder's phases) is treated like
a sweep. The sum does not depend on the length of the record, unlike a spectrum over the whole record of a noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from amb_core.designs.excitation.command import ABOVE_A, clipped_fundamental, limits
from amb_core.designs.excitation.content import Content, line_frequencies
from amb_core.loop.control import ControllerParameters
from amb_core.regions import Region
from amb_core.regions.lines import command_gain
from amb_core.regions.region_map import RegionMap

WINDOW = 0.25  # s, about the shortest span over which the classifier detects a drift
MARGIN_ERROR = 1e-3
MARGIN_STEPS = 30


@dataclass(frozen=True)
class Load:
    """Load of one axis.

    Attributes
    ----------
    towards : dict of Region to float
        Load towards B, C and D, or a higher region (-).
    linear : float
        Load towards B where the map shows it, with a bound elsewhere (-): below 1 region A is certain.
    bounded : float
        Contribution of that bound at frequencies at which the map shows only region A (-): lines count as if B began at
        the largest amplitude of the map.
    continued : float
        Share (-) of the squared `linear` from lines for which the map was extrapolated at constant control current:
        below its smallest amplitude or above its highest frequency.
    """

    towards: dict[Region, float]
    linear: float
    bounded: float
    continued: float


class AxisLoad:
    """Loads of a signal on one axis, at any factor on its amplitude.

    Parameters
    ----------
    content : Content
        Sines of the signal.
    current : ndarray, shape (steps,)
        Control current that it requests (A).
    sample_time : float
        Sample time (s).
    region_map : RegionMap
        The map.
    controller : ControllerParameters
        The control law.
    current_limit : float
        Limit of the control current that reaches the coils (A).
    """

    def __init__(
        self,
        content: Content,
        current: NDArray[np.float64],
        sample_time: float,
        region_map: RegionMap,
        controller: ControllerParameters,
        current_limit: float,
    ) -> None:
        self._limit = current_limit
        self._is_sweep = content.form == "instantaneous"
        if self._is_sweep:  # a window is an instant, with a single line
            frequency = content.frequency[:, None]
            self._windows = command_gain(frequency, controller) * content.amplitude[:, None]
        else:
            steps = min(len(current), round(WINDOW / sample_time))
            self._windows = sliding_window_view(current, steps)[:: max(1, steps // 2)]
            # The mean value over a window is a sine too slow for the window; it is taken at the map's lowest frequency.
            frequency = np.concatenate([[region_map.settings.frequency_start], line_frequencies(steps, sample_time)])
        gain = command_gain(frequency, controller)
        self._begins = {region: limits(region_map, region, frequency, controller) for region in ABOVE_A}
        self._allowed = {
            region: clipped_fundamental(gain * begin.amplitude, current_limit) for region, begin in self._begins.items()
        }

    def at(self, factor: float = 1.0) -> Load:
        """Loads of the signal multiplied by a positive factor."""
        current = factor * self._windows
        if self._is_sweep:
            lines = clipped_fundamental(current, self._limit)
        else:
            lines = _window_lines(np.clip(current, -self._limit, self._limit))
        squared = {region: (lines / allowed) ** 2 for region, allowed in self._allowed.items()}
        first = self._begins[Region.B]
        total = squared[Region.B].sum(axis=1)
        worst = int(np.argmax(total))
        parts = squared[Region.B][worst]
        reached, known = (flags[worst] if self._is_sweep else flags for flags in (first.reached, first.known))
        return Load(
            towards={
                region: float(np.sqrt((squared[region] * self._begins[region].reached).sum(axis=1).max()))
                for region in ABOVE_A
            },
            linear=float(np.sqrt(total[worst])),
            bounded=float(np.sqrt(parts[~reached].sum())),
            continued=float(parts[reached & ~known].sum() / total[worst]),
        )


def _window_lines(windows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Amplitudes of sines with the power of each window (by Hann), mean value first, shape (windows, lines)."""
    steps = windows.shape[1]
    weight = np.hanning(steps + 2)[1:-1]
    lines = np.abs(np.fft.rfft(windows * weight)) * (2.0 / np.sqrt(steps * np.sum(weight**2)))
    lines[:, 0] /= np.sqrt(2.0)
    return lines


def amplitude_margin(axes: Sequence[AxisLoad]) -> float:
    """Factor on the amplitude up to which region A is certain on all axes.

    The load rises with the factor, but slower once the current is clipped. So the iteration approaches the solution
    from one side: from above if the load was above 1, and from below if it was below.
    """
    factor = 1.0
    for _ in range(MARGIN_STEPS):
        load = max(axis.at(factor).linear for axis in axes)
        factor /= load
        if abs(load - 1.0) < MARGIN_ERROR:
            break
    return factor
