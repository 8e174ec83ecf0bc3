"""The link and the control law that the parameters of the bridge name."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from amb_core.errors import ParameterError
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_parameters import LinearControllerParameters
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.parameters import part_of
from amb_core.target import AmbUdpLink, HostLoopLink, TargetLink
from amb_core.target.key_file import read_key
from amb_sim_node.bridge_parameters import BridgeParameters, LinkParameters


def controller_of(settings: BridgeParameters) -> KnownController:
    """The law that is to close the loop on the target.

    Raises
    ------
    ParameterError
        If its file cannot be read, or is no controller.
    """
    if settings.controller_file:
        return LinearControl.load(settings.controller_file, part_of(LinearControllerParameters, settings.model_dump()))
    return part_of(ControllerParameters, settings.model_dump())


def require_host_loop(settings: BridgeParameters, link: TargetLink) -> None:
    """Refuse mode host where it cannot be.

    Raises
    ------
    ParameterError
        If the link takes no currents, or a parameter is for the mode target only.
    """
    if settings.mode == "target":
        return
    if not isinstance(link, HostLoopLink):
        raise ParameterError(
            f"mode = 'host' is not allowed with link.kind = {settings.link.kind!r}, which takes no currents from the "
            "host; allowed: mode target, or a subclass of HostLoopLink such as amb_udp"
        )
    for name in ("controller_file", "region_map"):
        if getattr(settings, name):
            raise ParameterError(
                f"{name} = {getattr(settings, name)!r} is not allowed with mode = 'host', where a controller node "
                "closes the loop and plays the excitations; leave it empty"
            )


def link_of(parameters: LinkParameters, starting: Callable[[], object]) -> TargetLink:
    """The link that the parameters name.

    Raises
    ------
    ParameterError, TargetError
        If there is none of that name, or its parameters are wrong.
    """
    if parameters.kind == "amb_udp":
        key = read_key(parameters.key_file) if parameters.key_file else b""
        return AmbUdpLink(
            parameters.address, parameters.port, key, parameters.float64, timeout=parameters.timeout, starting=starting
        )
    module, _, name = parameters.kind.partition(":")
    try:
        made = getattr(importlib.import_module(module), name)(parameters)
    except (ImportError, AttributeError, ValueError) as problem:
        raise ParameterError(
            f"link.kind = {parameters.kind!r} is not allowed: {problem}; allowed: amb_udp, or module:class"
        ) from None
    if not isinstance(made, TargetLink):
        raise ParameterError(f"link.kind = {parameters.kind!r} is not allowed; allowed: a subclass of TargetLink")
    return made
