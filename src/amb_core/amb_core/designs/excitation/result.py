"""Results of an excitation check, for an axis and for the whole excitation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.excitation.content import Form
from amb_core.designs.excitation.load import Load
from amb_core.regions import Region


@dataclass(frozen=True)
class AxisCheck:
    """An excitation on one axis, superimposed on the map.

    Attributes
    ----------
    axis : {"x", "y"}
        The axis.
    form : {"instantaneous", "lines", "bands"}
        Kind of the points, see `amb_core.designs.excitation.content`: instants of a sweep, lines, thirds of an octave.
    frequency, amplitude : ndarray, shape (n,)
        Points to draw on the map: frequency (Hz) and peak amplitude of the sine of the same power (m).
    share : ndarray, shape (n,)
        Share of each point in the power (-); the sum is 1.
    region : ndarray of int, shape (n,)
        Region of the map in which each point lies, as values of `Region`.
    covered : ndarray of bool, shape (n,)
        Whether the map shows it: false outside its frequencies, above its amplitudes, and below them if the smallest
        one is not in A.
    shares : dict of Region to float
        Share of the power in A, B, C and D (-); the sum is 1.
    load : Load
        Load towards B, C and D.
    predicted : Region
        Highest region with a load of 1 or more, else A.
    rms, peak : float
        Of the signal while the axis is excited (m).
    command_rms, command_peak : float
        Of the control current that the linearised loop requests, before any limit: rms of what the signal adds, and
        peak with the static current (A).
    slew_rms, slew_peak : float
        Of its rate of change (A/s).
    limited : float
        Share (-) of the samples in which it is above the limit of the control current, static current included.
    static_current : float
        Control current that holds the rotor at rest (A).
    slewed : float, optional
        Share (-) of the samples in which it changes faster than the voltage can drive it.
    current_margin, slew_margin : float
        Factor (-) on the amplitude at which `limited`, or `slewed`, reaches the share that a verdict of A allows.
    """

    axis: str
    form: Form
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    share: NDArray[np.float64]
    region: NDArray[np.int_]
    covered: NDArray[np.bool_]
    shares: dict[Region, float]
    load: Load
    predicted: Region
    rms: float
    peak: float
    command_rms: float
    command_peak: float
    slew_rms: float
    slew_peak: float
    limited: float
    static_current: float = 0.0
    slewed: float = 0.0
    current_margin: float = math.inf
    slew_margin: float = math.inf

    @property
    def crest_factor(self) -> float:
        """Peak over rms; a sine has 1.41, a square wave 1."""
        return self.peak / self.rms


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
        Share of the power of both axes in A, B, C and D (-); the sum is 1.
    predicted : Region
        Region of the rotor: the higher one of the axes.
    certain : bool
        Whether the map determines it; false if lines outside the map could lead to B or higher.
    margin : float
        Factor (-) by which the amplitude may be raised (above 1) or must be lowered (below 1): the smallest of
        `map_margin` and of the axes' margins of current and slew.
    verdict : str
        One line: where it would run, and what to do.
    notes : tuple of str
        Notes for the reader: content outside the map, a map of another axis, sample rate, controller or plant.
    bias_current : float
        Bias current of every electromagnet (A).
    current_limit : float
        Largest control current that the controller allows and all coils can follow (A).
    slew_rate : float or None
        Fastest change of a coil current (A/s); None where the amplifiers have no limits.
    map_margin : float
        Factor on the amplitude up to which the map shows region A for certain (-).
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
    slew_rate: float | None
    map_margin: float = math.inf
