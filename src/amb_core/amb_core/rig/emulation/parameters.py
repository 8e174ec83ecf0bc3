"""Parameters of the emulated target: its limits, and the faults that it shows on request."""

from __future__ import annotations

import math
from typing import Any

from amb_core.ground.parameters import Parameters, choice, quantity, switch
from amb_core.rig.link import Limits

_LIMITS = Limits()


class LimitParameters(Parameters):
    """Limits of the target, the highest that any host can set. The control current has that of the controller."""

    coil_current: float = quantity(_LIMITS.coil_current, "A", "measured coil current: trip", 1e-3, 1e4)
    coil_time: float = quantity(_LIMITS.coil_time, "s", "how long a coil current may be above its limit", 1e-4, 10.0)
    alarm_share: float = quantity(
        _LIMITS.alarm_share, "-", "radial displacement over clearance of a bearing: alarm", 1e-3, 100.0
    )
    trip_share: float = quantity(
        _LIMITS.trip_share, "-", "radial displacement over clearance of a bearing: trip", 1e-3, 100.0
    )
    excitation_amplitude: float = quantity(
        _LIMITS.excitation_amplitude, "m", "largest excitation of an axis", 1e-9, 1e-2
    )
    excitation_slew: float = quantity(
        _LIMITS.excitation_slew, "m/s", "largest change of the excitation of an axis, from and to zero too", 1e-6, 1e3
    )
    sensor_range: float = quantity(_LIMITS.sensor_range, "m", "largest measured position: trip", 1e-6, 1.0)
    stuck_time: float = quantity(
        _LIMITS.stuck_time,
        "s",
        "how long a position may stay the same bit for bit: trip; 0 for ever, where ideal sensors see a rotor at rest",
        0.0,
        100.0,
    )
    temperature: float = quantity(_LIMITS.temperature, "deg C", "temperature: trip", 1.0, 1_000.0)
    host_time: float = quantity(
        _LIMITS.host_time, "s", "time without a command until an armed or playing excitation stops", 1e-3, 1e6
    )
    land_time: float = quantity(0.0, "s", "time without a command until the machine lands; 0 for never", 0.0, 1e6)
    fade_time: float = quantity(
        _LIMITS.fade_time, "s", "time in which an excitation that is stopped goes to zero, or longer", 1e-4, 100.0
    )
    settle_time: float = quantity(
        _LIMITS.settle_time, "s", "time from levitation until displacement can trip", 1e-4, 100.0
    )
    # Ordinary operating systems stop a process for some milliseconds now and then.
    missed_steps: float = quantity(
        1_000.0, "-", "control steps missed lately: trip; those of a late machine count too", 1.0, 1e9
    )
    reference_slew: float = quantity(
        _LIMITS.reference_slew, "m/s", "fastest change of the reference, the excitation apart", 1e-6, 1e3
    )
    contact_share: float = quantity(
        _LIMITS.contact_share, "-", "as trip_share, while levitating, landing or settling", 1e-3, 100.0
    )
    lift_time: float = quantity(
        _LIMITS.lift_time,
        "s",
        "how long the rotor may be farther than trip_share from its reference: trip",
        1e-4,
        100.0,
    )
    saturation_time: float = quantity(
        _LIMITS.saturation_time, "s", "how long a control current may be at its limit: trip", 1e-4, 100.0
    )
    missed_share: float = quantity(
        _LIMITS.missed_share, "-", "share of missed control steps from which on they add up to missed_steps", 1e-6, 1.0
    )
    lock_time: float = quantity(
        _LIMITS.lock_time, "s", "time after a trip by displacement in which faults are not reset", 1e-4, 1e9
    )

    def with_current(self, control_current: float) -> Limits:
        """The limits of a target with a limit on its control current references (A); 0 of a time is no limit.

        Parameters
        ----------
        control_current : float
            Limit on the control current references (A).

        Returns
        -------
        Limits
            All limits of the target.
        """
        values = self.model_dump()
        for name in ("stuck_time", "land_time"):
            values[name] = values[name] or math.inf
        return Limits(control_current=control_current, **values)


def _share(description: str) -> Any:
    return quantity(0.0, "-", description, 0.0, 1.0, runtime=True)


class LinkFaults(Parameters):
    """Faults of the network in one direction. Each frame meets each of them independently."""

    loss: float = _share("share of frames that are lost")
    duplication: float = _share("share of frames that arrive twice")
    reordering: float = _share("share of frames that arrive after the next one")
    corruption: float = _share("share of frames with a wrong bit")
    delay: float = quantity(0.0, "s", "delay of every frame", 0.0, 10.0, runtime=True)
    delay_jitter: float = quantity(
        0.0, "s", "largest further delay, evenly distributed; later frames may overtake", 0.0, 10.0, runtime=True
    )

    @property
    def none(self) -> bool:
        """Whether there are no faults."""
        return not any(self.model_dump().values())


def _axes(description: str) -> Any:
    return choice("", description, runtime=True)


class SensorFaultParameters(Parameters):
    """Faults of position sensors. Axes are named such as `x_a, y_b`."""

    stuck: str = _axes("axes whose sensors repeat the present value")
    noisy: str = _axes("axes whose sensors have additional noise")
    noise: float = quantity(5e-6, "m", "standard deviation of that noise", 0.0, 1e-2, runtime=True)
    disturbed: str = _axes("axes whose sensors have that noise while the amplifiers are on")
    humming: str = _axes("axes whose sensors pick up the mains, 50 Hz")
    hum: float = quantity(3e-6, "m", "amplitude of it", 0.0, 1e-2, runtime=True)
    failed: str = _axes("axes whose sensors have failed: their positions are NaN")
    inverted: str = _axes("axes whose sensors have the wrong sign")
    swapped: str = _axes("two axes whose sensors are plugged in each other's place")
    turned: str = _axes("two axes whose sensors are turned together")
    angle: float = quantity(15.0, "deg", "angle by which they are turned", -180.0, 180.0, runtime=True)
    scaled: str = _axes("axes whose sensors have the wrong gain")
    scale: float = quantity(2.0, "-", "that gain over the right one", 0.0, 1e6, runtime=True)
    shifted: str = _axes("axes whose sensors have an offset")
    shift: float = quantity(150e-6, "m", "that offset", -1e-2, 1e-2, runtime=True)
    clipped: str = _axes("axes whose sensors end too early")
    reach: float = quantity(100e-6, "m", "largest position that they show", 0.0, 1e-2, runtime=True)
    coarse: str = _axes("axes whose converters have large steps")
    resolution: float = quantity(2e-6, "m", "those steps", 1e-12, 1e-2, runtime=True)
    late: str = _axes("axes whose positions come late")
    late_steps: float = quantity(1.0, "-", "by so many samples, whole ones", 0.0, 100.0, runtime=True)
    slow: str = _axes("axes whose sensors have a low-pass")
    corner: float = quantity(300.0, "Hz", "its corner frequency", 0.1, 1e6, runtime=True)


class CoilFaultParameters(Parameters):
    """Faults of amplifiers and coils: control currents that are not those that the target asks for."""

    inverted: str = _axes("axes whose coils are exchanged: the current pulls the other way")
    swapped: str = _axes("two axes whose amplifiers are connected in each other's place")
    dead: str = _axes("axes without control current")
    turned: str = _axes("two axes whose magnets are turned together")
    angle: float = quantity(15.0, "deg", "angle by which they are turned", -180.0, 180.0, runtime=True)
    scaled: str = _axes("axes whose amplifiers have the wrong gain")
    scale: float = quantity(2.0, "-", "that gain over the right one", 0.0, 1e6, runtime=True)
    shifted: str = _axes("axes whose amplifiers have an offset")
    shift: float = quantity(0.5, "A", "that offset", -100.0, 100.0, runtime=True)
    weak: str = _axes("axes whose amplifiers are at their limit too early")
    limit: float = quantity(0.3, "A", "largest control current that they deliver", 0.0, 100.0, runtime=True)
    late: str = _axes("axes whose currents come late")
    late_steps: float = quantity(1.0, "-", "by so many samples, whole ones", 0.0, 100.0, runtime=True)
    slow: str = _axes("axes whose amplifiers have a further low-pass")
    corner: float = quantity(300.0, "Hz", "its corner frequency", 0.1, 1e6, runtime=True)


class FaultParameters(Parameters):
    """Faults of network, sensors, coils, amplifiers and clock. All can change while the emulator runs."""

    seed: int = quantity(0, "-", "seed of all random faults; a change starts them anew", 0, 2**31 - 1, runtime=True)
    to_host: LinkFaults = LinkFaults()
    from_host: LinkFaults = LinkFaults()
    sensor: SensorFaultParameters = SensorFaultParameters()
    coil: CoilFaultParameters = CoilFaultParameters()
    amplifier: bool = switch(False, "the amplifiers report a fault", runtime=True)
    temperature: float = quantity(20.0, "deg C", "measured temperature", -273.0, 1e4, runtime=True)
    clock_drift: float = quantity(
        0.0, "ppm", "how much faster than the host's the clock of the target runs", -1e5, 1e5, runtime=True
    )
