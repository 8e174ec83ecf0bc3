"""Parameters of the hardware bridge, apart from those of the plant: a bridge that starts again must not load that."""

from __future__ import annotations

from typing import Literal

from amb_core.ground.parameters import Parameters, choice, quantities, quantity, switch
from amb_core.loop.allowed_changes import AllowedChanges
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.real_time import RealTimeParameters
from amb_core.rig import ProtectionParameters
from amb_core.rig.link import PORT, SILENCE


class LinkParameters(Parameters):
    """How the bridge reaches its target."""

    kind: str = choice("amb_udp", "amb_udp, or the name of an installed link of your own")
    address: str = choice("127.0.0.1", "address of the target, or serial:DEVICE?baud=N for a byte stream")
    port: int = quantity(PORT, "-", "UDP port of the target", 1, 65_535)
    key_file: str = choice("", "file with the shared key, mode 0600; empty: a target on this host, without a key")
    float64: bool = switch(False, "telemetry bit for bit as float64, in twice as many frames, instead of float32")
    timeout: float = quantity(1.0, "s", "longest wait for the reply to a command", 0.05, 60.0)
    silence: float = quantity(
        SILENCE, "s", "time without a frame after which the target is taken for gone; it sends one in 100 ms", 0.2, 60.0
    )


class BridgeParameters(ControllerParameters):
    """Parameters of the node: the PD law on the target, the link to it, and protection."""

    mode: Literal["target", "host"] = choice(
        "target", "who closes the loop: the target, or the host, where a controller node answers every sample"
    )
    without_host: Literal["off", "land"] = choice(
        "off", "in mode host, what the target does when the limit of missed steps is reached without a current"
    )
    controller_file: str = choice(
        "", "file of a state-space controller that closes the loop on the target; empty: the PD law"
    )
    link: LinkParameters = LinkParameters()
    protection: ProtectionParameters = ProtectionParameters()
    allowed: AllowedChanges = AllowedChanges()
    network: Literal["refuse", "allow"] = choice(
        "refuse", "whether the bridge levitates although other hosts of the network can reach, and so command, it"
    )
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
    signals_rate: float = quantity(
        100.0, "Hz", "messages on signals/<axis> per second of loop time, for plots; 0: none", 0.0, 1000.0
    )
