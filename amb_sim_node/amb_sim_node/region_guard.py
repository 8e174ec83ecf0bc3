"""Keeps excitations of a rig within region A of its map."""

from __future__ import annotations

from collections.abc import Callable

from amb_core.excitation import ExcitationSignal
from amb_core.ground.errors import ExcitationError, ParameterError
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_sim_node.bridge_parameters import BridgeParameters

Guard = Callable[[ExcitationSignal | None], None]
"""Raises ExcitationError for a signal that may leave region A; None: a user-defined waveform."""


def guard_of(settings: BridgeParameters, controller: KnownController) -> Guard:
    """The guard that the parameters of the bridge ask for; a map that cannot be read is noticed here.

    Raises
    ------
    RegionError, ParameterError
        If there is no such map, or it cannot be used with this controller.
    """
    if not settings.region_map or settings.beyond_region_a == "allow":
        return lambda _signal: None
    from amb_core.designs.excitation.beyond_a import highest_load  # loads a compiler
    from amb_core.regions.region_map import RegionMap

    if isinstance(controller, LinearControl):
        raise ParameterError("a region_map is for the PD law; with controller_file leave it empty")
    law, region_map = controller, RegionMap.load(settings.region_map)
    remedy = "allowed: smaller ones, or any with beyond_region_a: allow"

    def guard(signal: ExcitationSignal | None) -> None:
        if signal is None:
            raise ExcitationError(f"a waveform cannot be checked against the region map; {remedy}")
        highest = highest_load(signal, region_map, law)
        if highest.load >= 1.0:
            raise ExcitationError(
                f"it may leave region A of the map on {highest.axis}: load {highest.load:.2f}, where 1 is its end; "
                f"{remedy}"
            )

    return guard
