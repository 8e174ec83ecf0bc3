"""The analytic lines of `amb_core.regions.lines` for a given bearing, and how they compare with the simulated map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation.axes import factors_of
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters, describe
from amb_core.plant.machine import machine_of
from amb_core.regions import Region, lines
from amb_core.regions.region_map.excited_axes import axes_of_first_bearing
from amb_core.regions.region_map.map_sweep import BOUNDARIES
from amb_core.regions.region_map.region_map import RegionMap

POINTS = 2000  # of a line; between them its logarithm is linear, to within 1e-6


@dataclass(frozen=True)
class AnalyticLine:
    """A limit of linear operation over frequency.

    Attributes
    ----------
    name : str
        `static-load limit`, `bias limit`, `slew limit` or `gain-loss limit`.
    frequency : ndarray, shape (n,)
        Ascending, to the Nyquist frequency (Hz).
    amplitude : ndarray, shape (n,)
        Amplitude of the reference at the limit (m).
    """

    name: str
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]

    def frequency_at(self, amplitude: NDArray[np.float64]) -> NDArray[np.float64]:
        """Lowest frequency (Hz) from which an amplitude (m) is beyond the limit; NaN where it never or always is.

        Parameters
        ----------
        amplitude : ndarray, shape (n,)
            Amplitudes (m).

        Returns
        -------
        ndarray, shape (n,)
            Frequencies (Hz).
        """
        beyond = self.amplitude[None, :] <= amplitude[:, None]
        first = np.argmax(beyond, axis=1)
        lowest = np.full(len(amplitude), math.nan)
        for row in np.flatnonzero(first > 0):
            right = first[row]
            ends = slice(right - 1, right + 1)
            lowest[row] = np.exp(
                np.interp(-math.log(amplitude[row]), -np.log(self.amplitude[ends]), np.log(self.frequency[ends]))
            )
        return lowest


@dataclass(frozen=True)
class Comparison:
    """An analytic line compared with a simulated boundary, at the sweeps that have both.

    Attributes
    ----------
    line : str
        Name of the line.
    region : Region
        Region that begins at the boundary.
    amplitude : ndarray, shape (n,)
        Amplitudes of the sweeps (m).
    simulated, analytic : ndarray, shape (n,)
        Frequencies of boundary and line (Hz).
    """

    line: str
    region: Region
    amplitude: NDArray[np.float64]
    simulated: NDArray[np.float64]
    analytic: NDArray[np.float64]

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Frequency of the line over that of the boundary, shape (n,)."""
        return self.analytic / self.simulated

    @property
    def median(self) -> float:
        """Median of the ratio."""
        return float(np.median(self.ratio))

    @property
    def spread(self) -> float:
        """Half of the range of the ratio, over its median."""
        return float(np.ptp(self.ratio) / 2.0 / self.median)


def analytic_lines(
    plant: PlantParameters, controller: ControllerParameters, axes: str = "y", lowest_frequency: float = 10.0
) -> tuple[AnalyticLine, ...]:
    """The lines of a bearing, from its derived constants.

    A limit that the loop does not have (of an unlimited duty cycle, or of a gain too small to lose any) has no line.
    The static-load limit is the bias limit for the current that remains after the weight of the rotor is carried.
    Beyond it the peaks are cut on one side only: the mean force falls and the rotor sinks.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    axes : str, optional
        Axes that are excited, as in the settings of a map; gravity loads those along y.
    lowest_frequency : float, optional
        Where the lines begin (Hz).

    Returns
    -------
    tuple of AnalyticLine
        Amplitude over frequency of each limit.

    Raises
    ------
    PlantError
        If the plant cannot be built, or the controller cannot hold the rotor.
    """
    constants = describe(plant, controller)
    frequency = np.geomspace(lowest_frequency, 0.5 * controller.sample_rate, POINTS)
    bias = plant.amplifier.bias_current
    limit = min(controller.current_limit, bias) if plant.amplifier.unipolar else controller.current_limit
    amplitudes = {}
    static_current = controller.proportional_gain * abs(constants.sag)
    machine = machine_of(plant)
    excited = factors_of(axes_of_first_bearing(axes, machine), machine)
    loaded = any(factor and axis.direction[1] for axis, factor in zip(machine.axes, excited, strict=True))
    if loaded and 1e-3 * limit < static_current < limit:
        amplitudes["static-load limit"] = lines.bias_limit(frequency, controller, limit - static_current)
    if plant.amplifier.unipolar and bias > 0.0:
        amplitudes["bias limit"] = lines.bias_limit(frequency, controller, bias)
    if constants.slew_rate:
        amplitudes["slew limit"] = lines.slew_limit(frequency, controller, constants.slew_rate)
    if limit > 0.0 and constants.current_gain * controller.proportional_gain > constants.negative_stiffness:
        gains = constants.current_gain, constants.negative_stiffness
        amplitudes["gain-loss limit"] = lines.gain_loss_limit(frequency, controller, limit, *gains)
    return tuple(AnalyticLine(name, frequency, amplitude) for name, amplitude in amplitudes.items())


def compare(region_map: RegionMap, analytic: Sequence[AnalyticLine]) -> list[Comparison]:
    """Compare every line with every boundary, except onsets of D by ordinary resonance, which no line describes.

    Pairs without a common amplitude are left out.

    Parameters
    ----------
    region_map : RegionMap
        The simulated map.
    analytic : sequence of AnalyticLine
        From `analytic_lines`.

    Returns
    -------
    list of Comparison
        One for each pair of line and boundary.
    """
    comparisons = []
    for line in analytic:
        for region in BOUNDARIES:
            sweeps = [
                sweep
                for sweep in region_map.sweeps
                if region in sweep.boundaries and not sweep.boundaries[region].resonance
            ]
            amplitude = np.array([sweep.amplitude for sweep in sweeps])
            simulated = np.array([sweep.boundaries[region].frequency for sweep in sweeps])
            frequency = line.frequency_at(amplitude)
            both = np.isfinite(frequency)
            if both.any():
                comparisons.append(Comparison(line.name, region, amplitude[both], simulated[both], frequency[both]))
    return comparisons
