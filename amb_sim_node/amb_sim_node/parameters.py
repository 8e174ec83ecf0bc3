"""Parameters of the nodes of this package; no ROS needed to read a parameter file with them."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from amb_core.emulation import LOCALHOST, FaultParameters, LimitParameters
from amb_core.loop.control import ControllerParameters
from amb_core.loop.real_time import RealTimeParameters
from amb_core.parameters import Parameters, choice, quantities, quantity, switch
from amb_core.plant import PlantParameters
from amb_core.rig import ProtectionParameters
from amb_core.target import PORT

LONGEST_PERIOD = 0.05  # s of wall-clock time between two paced steps; services wait as long


class SimulatorParameters(PlantParameters):
    """Parameters of the simulator: those of the plant, and of its interface to the graph."""

    autostart: bool = switch(False, "run from the start instead of waiting, paused, for a run request")
    clock_period: float = quantity(0.01, "s", "simulation time between messages on /clock", 1e-4, 10.0)
    answer_timeout: float = quantity(
        0.25, "s", "wall-clock time after which the answer of the controller counts as overdue", 0.05, 10.0
    )
    real_time_factor: float = quantity(
        0.0, "-", "simulation time over wall-clock time at which the loop is paced; 0 for as fast as it can", 0.0, 100.0
    )
    plant_state_steps: int = quantity(
        0, "-", "controller steps between messages on plant_state; 0 for none", 0, 1_000_000
    )
    real_time: RealTimeParameters = RealTimeParameters()

    @model_validator(mode="after")
    def _paced_steps_do_not_block_services(self) -> SimulatorParameters:
        least = 1.0 / (self.integration.sample_rate * LONGEST_PERIOD)
        if 0.0 < self.real_time_factor < least:
            raise ValueError(
                f"real_time_factor = {self.real_time_factor:g} is not allowed at {self.integration.sample_rate:g} Hz; "
                f"allowed: 0, or from {least:g} on"
            )
        return self


class LinkParameters(Parameters):
    """How the bridge reaches its target."""

    kind: str = choice("amb_udp", "amb_udp, or module:class of a TargetLink of your own")
    address: str = choice("127.0.0.1", "address of the target")
    port: int = quantity(PORT, "-", "UDP port of the target", 1, 65_535)
    key_file: str = choice("", "file with the shared key, mode 0600; empty: a target on this host, without a key")
    float64: bool = switch(False, "telemetry bit for bit as float64, in twice as many frames, instead of float32")
    timeout: float = quantity(1.0, "s", "longest wait for the reply to a command", 0.05, 60.0)


class BridgeParameters(ControllerParameters):
    """Parameters of the node: the PD law on the target, the link to it, and protection."""

    controller_file: str = choice(
        "", "file of a state-space controller that closes the loop on the target; empty: the PD law"
    )
    link: LinkParameters = LinkParameters()
    protection: ProtectionParameters = ProtectionParameters()
    region_map: str = choice("", "file of the region map that excitations are checked against; empty: none")
    beyond_region_a: Literal["refuse", "allow"] = choice(
        "refuse", "what is done with an excitation that may leave region A of the map"
    )
    levitation_time: float = quantity(1.0, "s", "duration of levitation, from where the rotor lies", 0.0, 60.0)
    landing_time: float = quantity(1.0, "s", "duration of landing", 0.0, 60.0)
    real_time: RealTimeParameters = RealTimeParameters()
    landing_reference: tuple[float, ...] = quantities(
        "m", "where the reference of each axis ends before the currents are off; empty: the nominal one", -1e-2, 1e-2
    )
    at_exit: Literal["land", "stay"] = choice("land", "what an active bridge does with the rotor when it is ended")
    telemetry_block: int = quantity(100, "-", "steps in a block of telemetry", 1, 10_000)


class TargetEmulatorParameters(Parameters):
    """Parameters of the target emulator. The machine is that of simulator and controller in a parameter file."""

    parameter_file: str = choice(
        "",
        "parameter file whose blocks of simulator and pd_controller describe the machine and its gains, with "
        "package://NAME/PATH for one of a package; empty: the file with which the node was started, or the defaults",
    )
    address: str = choice(LOCALHOST, "IPv4 address on which it listens; another than loopback needs a key")
    port: int = quantity(PORT, "-", "UDP port on which it listens; 0 for any that is free", 0, 65_535)
    key_file: str = choice("", "file of mode 0600 with the key in hexadecimal digits; empty: no key")
    block_steps: int = quantity(10, "-", "control steps from one deadline to the next", 1, 50)
    real_time_factor: float = quantity(
        1.0, "-", "simulation time over wall-clock time; 0 for as fast as it can", 0.0, 100.0
    )
    real_time: RealTimeParameters = RealTimeParameters()
    limits: LimitParameters = LimitParameters()
    faults: FaultParameters = FaultParameters()
