"""The link and the control law that the parameters of the bridge name."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points

from amb_core.ground.errors import ParameterError, TargetError, one_line
from amb_core.ground.parameters import part_of
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_parameters import LinearControllerParameters
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.rig.link import (
    AmbUdpLink,
    HostLoopLink,
    LinkListener,
    TargetDescription,
    TargetLink,
    TargetStatus,
    TelemetryBlock,
)
from amb_core.rig.link.key_file import read_key
from amb_sim_node.bridge_parameters import BridgeParameters, LinkParameters

LINKS = "amb.links"
"""Group of entry points in which packages offer links of their own."""


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
    if settings.at_exit == "stay":
        raise ParameterError(
            "at_exit = 'stay' is not allowed with mode = 'host': no current reaches the target once the bridge has "
            "ended; allowed: land"
        )


def link_of(parameters: LinkParameters, starting: Callable[[], object], take_over: bool = True) -> TargetLink:
    """The link that the parameters name.

    Parameters
    ----------
    parameters : LinkParameters
        Kind, address and times.
    starting : callable
        Called first in the thread of the link.
    take_over : bool, optional
        Whether it connects to a rotor that is levitated. Links of others decide that themselves.

    Raises
    ------
    ParameterError, TargetError
        If there is none of that name, or its parameters are wrong.
    """
    if parameters.kind == "amb_udp":
        key = read_key(parameters.key_file) if parameters.key_file else b""
        return AmbUdpLink(
            parameters.address,
            parameters.port,
            key,
            parameters.float64,
            timeout=parameters.timeout,
            silence=parameters.silence,
            starting=starting,
            take_over=take_over,
        )
    return _installed_link(parameters.kind)(parameters)


def switch_off(parameters: LinkParameters) -> None:
    """Switch the currents of a target off at once, through a link of its own: no link to it is there.

    Parameters
    ----------
    parameters : LinkParameters
        Kind, address and times.

    Raises
    ------
    TargetError
        If the target does not answer: currents may flow.
    """
    link = link_of(parameters, lambda: None)
    try:
        link.connect(_Deaf())
        link.land(0.0)
    except TargetError as problem:
        raise TargetError(f"currents may flow, press the emergency stop: {one_line(problem)}") from None
    finally:
        link.close()


class _Deaf(LinkListener):
    """Needs nothing that a target sends."""

    def on_samples(self, block: TelemetryBlock) -> None:
        return

    def on_status(self, status: TargetStatus) -> None:
        return

    def on_silence(self) -> None:
        return

    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        return


def _installed_link(kind: str) -> Callable[[LinkParameters], TargetLink]:
    """The class that an installed package offers as link of this name; nothing else is imported or called."""
    installed = entry_points(group=LINKS)
    if kind not in installed.names:
        raise ParameterError(
            f"link.kind = {kind!r} is not allowed; allowed: {', '.join(['amb_udp', *sorted(installed.names)])}; a "
            f"package with a link of its own offers it as entry point of the group {LINKS}"
        )
    try:
        link = installed[kind].load()
    except (ImportError, AttributeError) as problem:
        raise ParameterError(f"link.kind = {kind!r} cannot be loaded: {problem}") from None
    if not (isinstance(link, type) and issubclass(link, TargetLink)):
        raise ParameterError(f"link.kind = {kind!r} is not allowed: it must be a subclass of TargetLink")
    return link
