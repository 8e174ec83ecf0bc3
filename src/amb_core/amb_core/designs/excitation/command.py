"""The control current that an excitation requests, and the control current at which the regions of a map begin.

The bearing's nonlinearity acts on the control current: its limit, its slew, and the square of the flux. Above the
bandwidth of the loop the rotor hardly moves, and the current is G r, with the control law G and the excitation r.
Current above the limit never reaches the coils. So it is clipped here on both sides of the comparison, in the signal
and in the sines of the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters
from amb_core.regions import Region
from amb_core.regions.lines import command_gain
from amb_core.regions.region_map import RegionMap

ABOVE_A = (Region.B, Region.C, Region.D)
GRID = 400
"""Amplitudes at which the boundaries of a map are looked up."""


def command(samples: NDArray[np.float64], controller: ControllerParameters, sample_time: float) -> NDArray[np.float64]:
    """Control current for a reference with the rotor at rest, without any limit (A), shape (steps,).

    Parameters
    ----------
    samples : ndarray, shape (steps,)
        Excitation of an axis (m), zero before the first sample.
    controller : ControllerParameters
        The control law.
    sample_time : float
        Sample time (s).
    """
    from scipy.signal import lfilter  # takes a second to import, and not needed by other commands

    current = controller.proportional_gain * samples
    if controller.derivative_on == "error":
        slow = controller.derivative_filter
        current += controller.derivative_gain * lfilter([1.0, -1.0], [slow + sample_time, -slow], samples)
    return current


def clipped_fundamental(amplitude: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    """Amplitude of the fundamental of clipped sines (describing function of the saturation)."""
    ratio = np.minimum(limit / np.maximum(amplitude, limit), 1.0)
    return amplitude * (2.0 / np.pi) * (np.arcsin(ratio) + ratio * np.sqrt(1.0 - ratio**2))


@dataclass(frozen=True)
class EntryAmplitudes:
    """Amplitudes at which sines enter a region or a higher one; on the dwell side of a map that is confirmed.

    Attributes
    ----------
    amplitude : ndarray, shape (n,)
        Amplitude at each frequency (m).
    known : ndarray of bool, shape (n,)
        Whether the map shows it. Otherwise there are two cases. If the largest amplitude of the map is still below the
        region, that amplitude is a lower bound. If the smallest amplitude is already in the region, or the frequency is
        above the map, the amplitude is extrapolated at constant control current.
    reached : ndarray of bool, shape (n,)
        Whether the amplitude is that of a boundary (shown or extrapolated), not the lower bound.
    """

    amplitude: NDArray[np.float64]
    known: NDArray[np.bool_]
    reached: NDArray[np.bool_]


def limits(
    region_map: RegionMap, region: Region, frequency: NDArray[np.float64], controller: ControllerParameters
) -> EntryAmplitudes:
    """Amplitudes at which sines enter a region or a higher one; on the dwell side of a map that is confirmed.

    Parameters
    ----------
    region_map : RegionMap
        The map.
    region : Region
        B, C or D.
    frequency : ndarray, shape (n,)
        Frequencies (Hz), positive.
    controller : ControllerParameters
        The control law, with which the map is extrapolated to smaller amplitudes and higher frequencies.
    """
    grid = np.geomspace(region_map.amplitudes[0], region_map.amplitudes[-1], GRID)
    begins = np.min([region_map.boundary(above, grid, "dwell") for above in ABOVE_A if above >= region], axis=0)
    begins = np.minimum.accumulate(begins)  # falls with amplitude
    start, end = region_map.settings.frequency_start, region_map.settings.frequency_end
    mapped = np.clip(frequency, start, end)
    linear = np.searchsorted(-begins, -mapped, side="left")  # grid amplitudes that are still below the region
    amplitude = grid[np.maximum(linear - 1, 0)]
    kept_from = np.where(linear == 0, min(begins[0], end), mapped)
    continued = (linear == 0) | (frequency > end)
    amplitude = np.where(
        continued, amplitude * command_gain(kept_from, controller) / command_gain(frequency, controller), amplitude
    )
    reached = linear < len(grid)
    return EntryAmplitudes(amplitude, reached & ~continued & (frequency >= start), reached)
