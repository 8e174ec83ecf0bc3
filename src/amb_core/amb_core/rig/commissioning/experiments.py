"""Excitations of a commissioning: small ones, inside region A of bearings like those of this project."""

from __future__ import annotations

from typing import Literal

from amb_core.excitation import Multisine, Square, Sweep, Tones
from amb_core.rig.commissioning.settings import CommissioningSettings

STEP_FREQUENCY = 4.0  # Hz: half a period is many times the settling time of a bearing
STEP_PERIODS = 4
MULTISINE_START = 2.0  # Hz
TONE_FREQUENCY, TONE_DURATION = 20.0, 8.0  # Hz, s; the tone is stopped long before


def small_steps(settings: CommissioningSettings, axes: int) -> Square:
    """Steps of the reference up and down, one axis after the other.

    Parameters
    ----------
    settings : CommissioningSettings
        Amplitude of the steps.
    axes : int
        Number of axes.

    Returns
    -------
    Square
        The excitation.
    """
    duration = axes * STEP_PERIODS / STEP_FREQUENCY
    return Square(amplitude=settings.step_amplitude, duration=duration, frequency=STEP_FREQUENCY, axes="in_turn")


def sweep(settings: CommissioningSettings) -> Sweep:
    """A rising sine, one axis after the other.

    Parameters
    ----------
    settings : CommissioningSettings
        Amplitude, duration and band.

    Returns
    -------
    Sweep
        The excitation.
    """
    return Sweep(
        amplitude=settings.sweep_amplitude,
        duration=settings.sweep_duration,
        axes="in_turn",
        frequency_start=settings.sweep_start,
        frequency_end=settings.sweep_end,
    )


def multisine(settings: CommissioningSettings) -> Multisine:
    """All axes in orthogonal experiments, for identification.

    Parameters
    ----------
    settings : CommissioningSettings
        Amplitude, duration and highest frequency.

    Returns
    -------
    Multisine
        The excitation.
    """
    return Multisine(
        amplitude=settings.multisine_amplitude,
        axes="orthogonal",
        duration=settings.multisine_duration,
        periods=4,
        frequency_start=MULTISINE_START,
        frequency_end=settings.multisine_end,
        phasing="optimised",
        odd=True,
    )


def tone(settings: CommissioningSettings, axis: str) -> Tones:
    """A sine on one axis that is stopped before its end.

    Parameters
    ----------
    settings : CommissioningSettings
        Amplitude.
    axis : str
        Name of the axis.

    Returns
    -------
    Tones
        The excitation.
    """
    return Tones(
        frequencies=(TONE_FREQUENCY,),
        amplitudes=(settings.sweep_amplitude,),
        phases=(),
        duration=TONE_DURATION,
        axes=axis,
    )


def order_of_rig(axes: int) -> int | Literal["auto"]:
    """Order of a model of a rig, with the noise of its sensors.

    States beyond those that the data of one bearing show become poles of noise, unstable ones too: `auto` stops before.
    With more axes `auto`, which compares the orders 1 to 14, takes many minutes; the least order that `order_for` gives
    is taken instead.

    Parameters
    ----------
    axes : int
        Number of axes.

    Returns
    -------
    int or {'auto'}
        Number of states, or the word.
    """
    return "auto" if axes <= 2 else order_for(axes)


def order_for(axes: int) -> int:
    """Order of an identified model of data with little noise.

    Two states for each rigid coordinate at an axis, and one for its amplifier; the paper's ten for one bearing.

    Parameters
    ----------
    axes : int
        Number of axes.

    Returns
    -------
    int
        Number of states.
    """
    return 10 if axes == 2 else 3 * axes
