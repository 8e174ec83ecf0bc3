"""The load that an excitation puts on the bearing, in terms of a region map: 1 where a region begins.

Regions B to D come from the mean square of the control current (the flux squared shifts the bias and adds to the
negative stiffness) and from the share of time in which it is cut off. Both are of second order: sines of different
frequencies add by their squares. Where I_k is the amplitude of the control current at the frequency f_k, and I_R(f)
the one at which a single sine enters region R, the load towards R is sqrt(sum_k (I_k / I_R(f_k))^2). For a single sine
that is the map itself; for noise it does not depend on the length of the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.control import ControllerParameters
from amb_core.excitation_design.command import ABOVE_A, clipped_fundamental, limits
from amb_core.excitation_design.content import Content, line_spectrum
from amb_core.region_map import RegionMap
from amb_core.regions import Region
from amb_core.regions.lines import command_gain

MARGIN_ERROR = 1e-3
MARGIN_STEPS = 30


@dataclass(frozen=True)
class Load:
    """Load of one axis.

    Attributes
    ----------
    towards : dict of Region to float
        Load towards B, C and D, or a higher region.
    bounded : float
        What lines add at most at frequencies at which the map shows no region but A: they count as if it began at the
        largest amplitude of the map.
    continued : float
        Share of the squared load towards B by lines to which the map had to be continued at constant control current:
        below its smallest amplitude or above its highest frequency.
    linear : float
        Load towards B with `bounded`: below 1 region A is certain.
    """

    towards: dict[Region, float]
    bounded: float
    continued: float
    linear: float


class AxisLoad:
    """Loads of a signal on one axis, at any factor on its amplitude.

    Parameters
    ----------
    content : Content
        Sines of the signal.
    current : ndarray, shape (steps,)
        Control current that it asks for (A).
    sample_time : float
        Sample time (s).
    region_map : RegionMap
        The map.
    controller : ControllerParameters
        The control law.
    current_limit : float
        Control current beyond which nothing reaches the coils (A).
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
        self._one_by_one = content.form == "instantaneous"
        self._sample_time, self._limit = sample_time, current_limit
        frequency: NDArray[np.float64]
        frequency = content.frequency if self._one_by_one else np.fft.rfftfreq(len(current), sample_time)[1:]
        gain = command_gain(frequency, controller)
        self._current = gain * content.amplitude if self._one_by_one else current
        self._begins = {region: limits(region_map, region, frequency, controller) for region in ABOVE_A}
        self._allowed = {
            region: clipped_fundamental(gain * begin.amplitude, current_limit) for region, begin in self._begins.items()
        }

    def at(self, factor: float = 1.0) -> Load:
        """Loads when the signal is multiplied by a positive factor."""
        current = factor * self._current
        lines: NDArray[np.float64]
        if self._one_by_one:
            lines = clipped_fundamental(current, self._limit)
        else:
            lines = line_spectrum(np.clip(current, -self._limit, self._limit), self._sample_time)[1]
        squared = {region: (lines / allowed) ** 2 for region, allowed in self._allowed.items()}
        towards = {region: self._total(squared[region], self._begins[region].reached) for region in ABOVE_A}
        first = self._begins[Region.B]
        continued = self._total(squared[Region.B], first.reached & ~first.known)
        return Load(
            towards={region: float(np.sqrt(total)) for region, total in towards.items()},
            bounded=float(np.sqrt(self._total(squared[Region.B], ~first.reached))),
            continued=continued / towards[Region.B] if towards[Region.B] > 0.0 else 0.0,
            linear=float(np.sqrt(self._total(squared[Region.B]))),
        )

    def _total(self, squared: NDArray[np.float64], counted: NDArray[np.bool_] | bool = True) -> float:
        """Sum of what adds up, largest of what follows one another."""
        chosen = np.where(counted, squared, 0.0)
        return float(np.max(chosen) if self._one_by_one else np.sum(chosen))


def amplitude_margin(axes: Sequence[AxisLoad]) -> float:
    """Factor on the amplitude at which the first axis leaves region A for certain.

    The load rises with the factor, but slower once the current is cut off; so each step of this iteration lands above
    the factor sought or on it where the load was above 1, and below or on it where it was below.
    """
    factor = 1.0
    for _ in range(MARGIN_STEPS):
        load = max(axis.at(factor).linear for axis in axes)
        factor /= load
        if abs(load - 1.0) < MARGIN_ERROR:
            break
    return factor
