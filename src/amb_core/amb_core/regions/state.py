"""Output of the classifier: a region per axis, per bearing and for the rotor, with the features that led to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from amb_core.ground.errors import RegionError


class Region(IntEnum):
    """Regions of operation of the paper, in the order in which a rising input frequency enters them."""

    A = 0
    """Linear."""
    B = 1
    """The bias drifts."""
    C = 2
    """Oscillation much slower than the input."""
    D = 3
    """Delevitated."""


@dataclass(frozen=True)
class Onset:
    """Where a region begins.

    Attributes
    ----------
    step : int
        Controller step; for B and C it is estimated afterwards, so it lies before the step of detection.
    time : float
        Time of that step from step 0 of the run (s).
    input_frequency : float
        Frequency of the input at that step (Hz); NaN where the input is no sine.
    resonance : bool
        Whether the loop then responded to its input by `resonance_gain` or more: a D with this mark and without a B or
        C before it is the ordinary resonance of the linear loop.
    """

    step: int
    time: float
    input_frequency: float
    resonance: bool


@dataclass(frozen=True)
class AxisState:
    """One axis at one update.

    Attributes
    ----------
    region : Region
        Region of the axis; D holds for all axes of a bearing that the rotor touches.
    since : Onset
        Where this region begins.
    bias : float
        Bias: position without input, harmonics and slow oscillation (m).
    trend : float
        Slope of the bias over the span of the most significant trend test (m/s).
    trend_significance : float
        Its t statistic divided by the critical value of the test (-): significant if 1 or more.
    oscillation_amplitude, oscillation_frequency : float
        Largest line of the slow band that is not a beat (m, Hz).
    input_frequency : float
        Instantaneous frequency of a sine, else the root mean square frequency of the input (Hz); 0 without input.
    input_amplitude : float
        Peak amplitude of a sine, else the square root of twice the variance (m).
    response_amplitude : float
        Peak amplitude of the position at the frequency of a sine (m); 0 for other inputs.
    sampling_beat : bool
        Whether a harmonic of the input, folded at the sample rate, explains a slow oscillation.
    drift, oscillation : Onset or None
        Where a drift of the bias and a slow oscillation begin, if there is evidence: the two do not hide each other.
        None without evidence.
    steady_frequency, steady_amplitude : float
        Largest line that was there before the excitation, such as that of the turning rotor (Hz, m); 0 without one. It
        counts neither as drift nor as oscillation.
    even_distortion, odd_distortion : float
        Second and third harmonic of the position over the first (-), noise included; NaN unless the input of the axis
        is a sine below 0.15 of the sample rate. Region A does not imply that they are small.
    frozen : bool
        Whether the position has not changed at all while the reference moved: the sensor stands, its region means
        nothing.
    not_judged : str
        Letters of the regions that were not looked for at this update, such as `BC`; region A says nothing of them. B
        while the loop resonates, the reference moves slowly, the tests begin again after that, or the bias has moved
        too slowly for them; C where a slow line may have another cause; both before the state is settled and while the
        rotor touches a bearing; D where the clearance is not known. Empty in bags of earlier versions.
    name : str
        Of the axis.
    """

    region: Region
    since: Onset
    bias: float
    trend: float
    trend_significance: float
    oscillation_amplitude: float
    oscillation_frequency: float
    input_frequency: float
    input_amplitude: float
    response_amplitude: float
    sampling_beat: bool
    drift: Onset | None = None
    oscillation: Onset | None = None
    steady_frequency: float = 0.0
    steady_amplitude: float = 0.0
    even_distortion: float = math.nan
    odd_distortion: float = math.nan
    frozen: bool = False
    not_judged: str = ""
    name: str = ""


@dataclass(frozen=True)
class BearingState:
    """One bearing at one update.

    Attributes
    ----------
    name : str
        Of the bearing.
    region : Region
        The highest of its axes.
    radius : float
        Largest displacement since the last update (m): radial, or along the shaft in a thrust bearing.
    """

    name: str
    region: Region
    radius: float


@dataclass(frozen=True)
class RegionState:
    """Axes, bearings and rotor at one update.

    Attributes
    ----------
    step : int
        Last controller step that was processed.
    axes : tuple of AxisState
        The axes, in the order of the machine.
    bearings : tuple of BearingState
        The bearings, in the order of their axes; empty in bags of version 0.1.
    region : Region
        Region of the rotor: the highest of its axes.
    since : Onset
        Where the rotor's region begins.
    radius : float
        Largest radial position in a radial bearing since the last update (m).
    settled : bool
        Whether B and C could have been found: false after a start, a gap or a change of the excitation, until the
        settling time is over and their shortest tests are complete, by default for 0.6 s.
    """

    step: int
    axes: tuple[AxisState, ...]
    bearings: tuple[BearingState, ...]
    region: Region
    since: Onset
    radius: float
    settled: bool

    def axis(self, name: str) -> AxisState:
        """The axis of this name.

        Parameters
        ----------
        name : str
            Name of the axis.

        Returns
        -------
        AxisState
            Its state.

        Raises
        ------
        RegionError
            If there is none.
        """
        for axis in self.axes:
            if axis.name == name:
                return axis
        names = ", ".join(axis.name for axis in self.axes)
        raise RegionError(f"no axis {name!r} at step {self.step}; its axes: {names}")

    @property
    def not_judged(self) -> str:
        """Letters of the regions that were not looked for on some axis at this update, such as `BC`."""
        return "".join(region.name for region in Region if any(region.name in axis.not_judged for axis in self.axes))

    @property
    def sampling_beat(self) -> bool:
        """Whether the input of an axis beats with the sample rate."""
        return any(axis.sampling_beat for axis in self.axes)
