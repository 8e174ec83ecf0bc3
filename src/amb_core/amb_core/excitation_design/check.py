"""Excitation check: in which regions of a region map an excitation would run (paper, section 3.5, Fig. 11 and 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.control import ControllerParameters
from amb_core.excitation import ExcitationSignal
from amb_core.excitation_design.content import Form
from amb_core.plant import PlantParameters
from amb_core.region_map import RegionMap
from amb_core.regions import Region


@dataclass(frozen=True)
class AxisCheck:
    """An excitation on one axis, superimposed on the map.

    Attributes
    ----------
    axis : {"x", "y"}
        The axis.
    form : {"instantaneous", "lines", "bands"}
        What the points are, see `amb_core.excitation_design.content`: instants of a sweep, lines, thirds of an octave.
    frequency, amplitude : ndarray, shape (n,)
        Points to draw on the map: frequency (Hz) and peak amplitude of the sine of the same power (m).
    share : ndarray, shape (n,)
        Share of each point in the power; the sum is 1.
    region : ndarray of int, shape (n,)
        Region of the map in which each point lies, as values of `Region`.
    covered : ndarray of bool, shape (n,)
        Whether the map tells it: false where a point lies outside its frequencies or above its amplitudes.
    shares : dict of Region to float
        Share of the power in A, B, C and D; the sum is 1.
    load : dict of Region to float
        Load towards B, C and D: 1 where region B (or a higher one), C (or D), or D begins. See `docs/excitation.md`.
    unmapped_load : float
        What the lines of which the map knows no limit add to the load at most.
    predicted : Region
        Highest region whose load is 1 or more, else A.
    rms, peak : float
        Of the signal while the axis is excited (m).
    command_rms, command_peak : float
        Of the control current that the signal asks for, before any limit (A).
    slew_rms, slew_peak : float
        Of its rate of change (A/s).
    limited : float
        Share of the time in which it is beyond the limit of the control current.
    """

    axis: str
    form: Form
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    share: NDArray[np.float64]
    region: NDArray[np.int_]
    covered: NDArray[np.bool_]
    shares: dict[Region, float]
    load: dict[Region, float]
    unmapped_load: float
    predicted: Region
    rms: float
    peak: float
    command_rms: float
    command_peak: float
    slew_rms: float
    slew_peak: float
    limited: float

    @property
    def crest_factor(self) -> float:
        """Peak over rms; a sine has 1.41, a square wave 1."""
        return self.peak / self.rms

    @property
    def linear_load(self) -> float:
        """Load towards B with what the map does not tell counted in full; region A is certain below 1."""
        return float(np.hypot(self.load[Region.B], self.unmapped_load))


@dataclass(frozen=True)
class ExcitationCheck:
    """An excitation superimposed on a region map.

    Attributes
    ----------
    kind : str
        Kind of the excitation.
    axes : tuple of AxisCheck
        The excited axes, x before y.
    shares : dict of Region to float
        Share of the power of both axes in A, B, C and D; the sum is 1.
    predicted : Region
        Region of the rotor: the higher one of the axes.
    certain : bool
        Whether the map tells it; false where lines outside of the map could lead to B or higher.
    margin : float
        Factor by which the amplitude may be raised (above 1) or must be lowered (below 1) to stay in A for certain.
    verdict : str
        One line: where it would run, and what to do.
    notes : tuple of str
        What a reader should know: content outside the map, a map of another axis, sample rate, controller or plant.
    bias_current, current_limit, slew_rate : float
        Limits to compare the commands with: bias current (A), limit of the control current (A), fastest change of a
        coil current (A/s).
    """

    kind: str
    axes: tuple[AxisCheck, ...]
    shares: dict[Region, float]
    predicted: Region
    certain: bool
    margin: float
    verdict: str
    notes: tuple[str, ...]
    bias_current: float
    current_limit: float
    slew_rate: float


def check_excitation(
    signal: ExcitationSignal,
    region_map: RegionMap,
    controller: ControllerParameters | None = None,
    plant: PlantParameters | None = None,
) -> ExcitationCheck:
    """Superimpose an excitation on a region map.

    Parameters
    ----------
    signal : ExcitationSignal
        From `amb_core.excitation.generate`.
    region_map : RegionMap
        Of the bearing that is to be excited.
    controller, plant : ControllerParameters, PlantParameters, optional
        Of that bearing; by default those of the paper. A map made with others is told in `notes`.

    Raises
    ------
    ExcitationError
        If the signal is zero throughout.
    """
    raise NotImplementedError
