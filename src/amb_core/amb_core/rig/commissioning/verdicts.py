"""Measured responses and models compared with limits, and with what a model of the machine predicts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.linear.model import StateSpaceModel
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.expected import Expected
from amb_core.rig.commissioning.protocol import Check, at_least, at_most, between, measured
from amb_core.rig.commissioning.response import ClosedLoop, StaticResponse, fit_second_order
from amb_core.rig.commissioning.settings import CommissioningSettings

_SCALE = "scale of its sensor, gain of its amplifier, or a plant in the parameter file that is not this machine"
_UP = 0.5  # component of an axis along the vertical from which the weight decides the sign of its current


def calibration_checks(
    response: StaticResponse,
    current: NDArray[np.float64],
    machine: Machine,
    settings: CommissioningSettings,
    expected: Expected | None,
) -> list[Check]:
    """Polarity, calibration and cabling of each axis, from small steps of its reference.

    Parameters
    ----------
    response : StaticResponse
        Measured with the steps.
    current : ndarray, shape (axes,)
        Control currents at rest (A).
    machine : Machine
        The axes.
    settings : CommissioningSettings
        Limits.
    expected : Expected, optional
        Of the model of the machine. None without a model: then nothing is compared with it.

    Returns
    -------
    list of Check
        The checks of each axis.
    """
    checks = []
    for axis, name in enumerate(machine.axis_names):
        own, what = float(response.gain[axis, axis]), f"position over reference of {name}"
        advice = f"the position does not follow: polarity or {_SCALE}"
        if expected is None:
            checks.append(between(what, own, settings.gain_low, settings.gain_high, "-", advice))
        else:
            middle, error = float(expected.gain[axis, axis]), settings.gain_error
            low, high = sorted((middle * (1.0 - error), middle * (1.0 + error)))
            checks.append(between(what, own, low, high, "-", advice))
        others = np.delete(np.abs(response.gain[:, axis]), axis)
        if len(others):
            coupling = float(others.max()) / max(abs(own), 1e-9)
            other = np.delete(np.array(machine.axis_names), axis)[int(np.argmax(others))]
            advice = f"cables of {name} and {other} may be swapped, or their sensors turned"
            checks.append(at_most(f"motion of {other} with {name}", coupling, settings.coupling, "-", advice))
        checks.append(_static_current(axis, float(current[axis]), machine, settings, expected))
    return checks


def _static_current(
    axis: int, value: float, machine: Machine, settings: CommissioningSettings, expected: Expected | None
) -> Check:
    what = f"control current at rest of {machine.axis_names[axis]}"
    advice = (
        "another load, sensor offset or gain than in the parameter file; with the opposite sign, sensor and coils of "
        "this axis are both reversed"
    )
    if expected is not None:
        middle = float(expected.current[axis])
        return between(what, value, middle - settings.current_error, middle + settings.current_error, "A", advice)
    if machine.axes[axis].direction[1] > _UP:
        return at_least(what, value, 0.0, "A", "the current does not carry the weight: sensor and coils both reversed?")
    return measured(what, value, "A")


def resonance_checks(
    loops: Sequence[ClosedLoop], settings: CommissioningSettings, expected: Expected | None
) -> list[Check]:
    """Natural frequency and damping ratio of each axis, against those that the same fit finds in the model.

    Parameters
    ----------
    loops : sequence of ClosedLoop
        Measured response of each axis, in their order.
    settings : CommissioningSettings
        Limits.
    expected : Expected or None
        Of the model of the machine; None to compare nothing.

    Returns
    -------
    list of Check
        Two checks for each axis.

    Raises
    ------
    IdentificationError
        If the model has no resonance in the band.
    """
    checks = []
    for axis, loop in enumerate(loops):
        natural, damping = loop.resonance.natural_hz, loop.resonance.damping_ratio
        names = f"natural frequency of {loop.axis}", f"damping ratio of {loop.axis}"
        if expected is None:
            advice = "hardly damped: more derivative gain, or less delay"
            checks += [measured(names[0], natural, "Hz"), at_least(names[1], damping, 0.05, "-", advice)]
            continue
        model = fit_second_order(loop.frequency, expected.response(loop.frequency, axis))
        low, high = (model.natural_hz * (1.0 + sign * settings.resonance_error) for sign in (-1.0, 1.0))
        checks.append(between(names[0], natural, low, high, "Hz", f"mass, bias current, {_SCALE}"))
        low, high = (model.damping_ratio + sign * settings.damping_error for sign in (-1.0, 1.0))
        checks.append(between(names[1], damping, low, high, "-", "delay, filters, or a lag of the amplifiers"))
    return checks


def model_checks(
    model: StateSpaceModel,
    excited: LoopRecord,
    rest: LoopRecord,
    settings: CommissioningSettings,
    expected: Expected | None,
) -> list[Check]:
    """How much of the motion the identified model explains in closed loop, noise apart, and its unstable poles.

    The error of the simulated loop contains the noise of the loop at rest, which no model explains.

    Parameters
    ----------
    model : StateSpaceModel
        Identified, with its closed-loop fit.
    excited, rest : LoopRecord
        The experiment, and the loop at rest before it.
    settings : CommissioningSettings
        Limits.
    expected : Expected, optional
        Of the model of the machine. None without a model of the machine.

    Returns
    -------
    list of Check
        Checks of the explained motion of each axis, and of the unstable poles.
    """
    checks = []
    motion, noise = excited.position.std(axis=0), rest.position.std(axis=0)
    for axis, name in enumerate(model.output_names):
        error = (1.0 - 0.01 * float(model.fit[axis])) * motion[axis]
        unexplained = 100.0 * float(np.sqrt(max(error**2 - noise[axis] ** 2, 0.0)) / motion[axis])
        checks += [
            measured(f"closed-loop fit of {name}", float(model.fit[axis]), "percent"),
            at_most(f"motion of {name} not explained, noise apart", unexplained, settings.unexplained, "percent",
                    "distortion, too low an order, or a machine that changes: see report.html"),
        ]  # fmt: skip
    count = float(len(model.unstable_poles()))
    what = "unstable poles of the plant"
    if expected is None:
        return [*checks, measured(what, count)]
    wanted = float(expected.unstable_poles)
    return [*checks, between(what, count, wanted, wanted, "-", "too short an experiment, or another plant")]


def fade_checks(
    reference: NDArray[np.float64], stopped: int, sample_time: float, settings: CommissioningSettings
) -> list[Check]:
    """Whether an excitation that was stopped has faded.

    Parameters
    ----------
    reference : ndarray, shape (steps, axes)
        References (m) until well after the stop; in its last row nothing is excited any more.
    stopped : int
        Row at which the stop was asked for.
    sample_time : float
        Of the rows (s).
    settings : CommissioningSettings
        Limits.

    Returns
    -------
    list of Check
        One check, of the time.
    """
    moving = np.flatnonzero(np.any(reference != reference[-1], axis=1))
    seconds = (int(moving[-1]) + 1 - stopped) * sample_time if len(moving) else 0.0
    advice = "fade_time of the target's configuration, or its watch for a silent host"
    return [at_most("time from the stop until the reference is at rest", max(seconds, 0.0), settings.fade, "s", advice)]
