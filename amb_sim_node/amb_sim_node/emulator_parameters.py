"""Parameters of the target emulator; no ROS needed to read a parameter file with them."""

from __future__ import annotations

from amb_core.ground.parameters import Parameters, choice, quantity, switch
from amb_core.loop.real_time import RealTimeParameters
from amb_core.rig.emulation import LOCALHOST, FaultParameters, LimitParameters
from amb_core.rig.link import PORT


class TargetEmulatorParameters(Parameters):
    """Parameters of the target emulator. The machine is that of simulator and controller in a parameter file."""

    parameter_file: str = choice(
        "",
        "parameter file whose blocks of simulator and pd_controller describe the machine and its gains, with "
        "package://NAME/PATH for one of a package; empty: the file with which the node was started, or the defaults",
    )
    address: str = choice(
        LOCALHOST,
        "IPv4 address on which it listens, another than loopback needs a key; serial:pty for a byte stream, whose "
        "device it logs",
    )
    port: int = quantity(PORT, "-", "UDP port on which it listens; 0 for any that is free", 0, 65_535)
    key_file: str = choice("", "file of mode 0600 with the key in hexadecimal digits; empty: no key")
    block_steps: int = quantity(10, "-", "control steps from one deadline to the next", 1, 50)
    real_time_factor: float = quantity(
        1.0, "-", "simulation time over wall-clock time; 0 for as fast as it can", 0.0, 100.0
    )
    host_patience: float = quantity(
        0.0,
        "s",
        "lock-step where the host closes the loop: longest wait for its current after each step, in which the emulated "
        "time stands still; 0 for none",
        0.0,
        60.0,
    )
    ideal: bool = switch(
        False,
        "whether the plant is that of the simulation, bit for bit; otherwise its rotor lies on the backup bearing "
        "while it is off, and bounces on it, and its sensors have noise and quantisation",
    )
    plant_waits: bool = switch(
        False,
        "whether the plant stands still in steps that a late machine has missed; otherwise it moves on with the "
        "currents held, as a rotor does",
    )
    real_time: RealTimeParameters = RealTimeParameters()
    limits: LimitParameters = LimitParameters()
    faults: FaultParameters = FaultParameters()
