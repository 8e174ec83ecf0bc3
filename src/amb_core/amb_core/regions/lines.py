"""Analytic lines of the frequency-amplitude graph: where limits of amplifier and controller end linear operation.

All lines hold for a sine of amplitude a in the reference position, at frequencies where the rotor no longer follows:
the control current then has the amplitude |G| a, G being the control law from reference to control current.

Sources: control law and limits of the paper's table 1; describing functions: Gelb, Vander Velde, "Multiple-Input
Describing Functions and Nonlinear System Design", McGraw-Hill 1968, section 6.2 (dither); force and stiffness:
Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, chapters 2 and 4.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import RegionError
from amb_core.loop.control import ControllerParameters


def command_gain(
    frequency: ArrayLike, controller: ControllerParameters, *, sampled: bool = True
) -> NDArray[np.float64]:
    """Magnitude of the control law from reference to control current, |G| (A/m).

    Parameters
    ----------
    frequency : array_like
        Frequencies (Hz), positive.
    controller : ControllerParameters
        The control law; with the derivative on measurement, G is the proportional gain alone.
    sampled : bool, optional
        The law as it is computed, with its backward difference; else K_P + j w K_D / (1 + j w tau_f). The difference of
        a sampled sine is smaller than the derivative: by 14 % at 3 kHz and 10 kHz sampling.
    """
    angular = 2.0 * np.pi * _positive("frequency", frequency)
    if controller.derivative_on == "measurement":
        return np.full(angular.shape, controller.proportional_gain)
    if sampled:
        time = 1.0 / controller.sample_rate
        delay = np.exp(-1j * angular * time)
        derivative = (1.0 - delay) / (controller.derivative_filter * (1.0 - delay) + time)
    else:
        derivative = 1j * angular / (1.0 + 1j * angular * controller.derivative_filter)
    return np.abs(controller.proportional_gain + controller.derivative_gain * derivative)


def bias_limit(
    frequency: ArrayLike, controller: ControllerParameters, bias_current: float, *, sampled: bool = True
) -> NDArray[np.float64]:
    """Amplitude at which the control current reaches the bias current, i_0 / |G| (m).

    Beyond it, the reference of a coil current becomes negative, which a unipolar amplifier cannot follow.

    Parameters
    ----------
    frequency : array_like
        Frequencies (Hz).
    controller : ControllerParameters
        The control law.
    bias_current : float
        Bias current i_0 (A).
    sampled : bool, optional
        See `command_gain`.
    """
    return _positive("bias_current", bias_current) / command_gain(frequency, controller, sampled=sampled)


def slew_limit(
    frequency: ArrayLike, controller: ControllerParameters, slew_rate: float, *, sampled: bool = True
) -> NDArray[np.float64]:
    """Amplitude at which the control current changes as fast as the amplifier can, slew rate / (w |G|) (m).

    Parameters
    ----------
    frequency : array_like
        Frequencies (Hz).
    controller : ControllerParameters
        The control law.
    slew_rate : float
        Voltage over inductance (A/s).
    sampled : bool, optional
        See `command_gain`.
    """
    angular = 2.0 * np.pi * np.asarray(frequency, dtype=np.float64)
    return _positive("slew_rate", slew_rate) / (angular * command_gain(frequency, controller, sampled=sampled))


def gain_loss_limit(
    frequency: ArrayLike,
    controller: ControllerParameters,
    limit: float,
    current_gain: float,
    negative_stiffness: float,
    *,
    sampled: bool = True,
) -> NDArray[np.float64]:
    """Amplitude at which the saturated loop no longer outweighs the negative stiffness (m).

    The dithered saturation leaves N k_i K_P of the stiffness; N k_i K_P = k_s at the dither limit / sin(pi k_s /
    (2 k_i K_P)), without static load. Beyond it, the centre is no longer stable: the rotor drifts away or falls.

    Parameters
    ----------
    frequency : array_like
        Frequencies (Hz).
    controller : ControllerParameters
        The control law.
    limit : float
        Control current at which the loop saturates: the lower of the controller's limit and the bias current (A).
    current_gain, negative_stiffness : float
        k_i (N/A) and k_s (N/m, positive).
    sampled : bool, optional
        See `command_gain`.

    Raises
    ------
    RegionError
        If the loop cannot levitate even without dither, k_i K_P <= k_s.
    """
    share = float(_positive("negative_stiffness", negative_stiffness)) / _stiffness(current_gain, controller)
    if share >= 1.0:
        raise RegionError(
            f"k_i K_P = {_stiffness(current_gain, controller):g} N/m must exceed the negative stiffness "
            f"{negative_stiffness:g} N/m, or the rotor does not levitate at all"
        )
    dither = float(_positive("limit", limit)) / math.sin(0.5 * math.pi * share)
    return dither / command_gain(frequency, controller, sampled=sampled)


def _stiffness(current_gain: float, controller: ControllerParameters) -> float:
    return float(_positive("current_gain", current_gain)) * controller.proportional_gain


def _positive(name: str, value: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(value, dtype=np.float64)
    if not np.all((values > 0.0) & np.isfinite(values)):
        wrong = values[~((values > 0.0) & np.isfinite(values))].flat[0]
        raise RegionError(f"{name} = {wrong:g} is not allowed; it must be positive and finite")
    return values
