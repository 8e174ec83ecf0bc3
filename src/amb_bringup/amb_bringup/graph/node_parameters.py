"""The nodes of the graph with their parameter sets, and the check of a parameter file for all of them."""

from __future__ import annotations

from pathlib import Path

from amb_controller_node.parameters import GeneratorParameters, PdControllerParameters, StateSpaceControllerParameters
from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import Parameters, load_parameters
from amb_core.plant.machine import machine_of
from amb_ident_node.identifier_parameters import IdentifierParameters
from amb_ident_node.recorder_parameters import RecorderParameters
from amb_ident_node.region_monitor_parameters import RegionMonitorParameters
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.emulator_parameters import TargetEmulatorParameters
from amb_sim_node.parameters import SimulatorParameters

PARAMETERS: dict[str, type[Parameters]] = {
    "simulator": SimulatorParameters,
    "pd_controller": PdControllerParameters,
    "state_space_controller": StateSpaceControllerParameters,
    "excitation_generator": GeneratorParameters,
    "recorder": RecorderParameters,
    "region_monitor": RegionMonitorParameters,
    "identifier": IdentifierParameters,
    "hardware_bridge": BridgeParameters,
    "target_emulator": TargetEmulatorParameters,
}
"""Every node of `amb_core.ground.files.parameter_files.KNOWN_NODES`, and its parameters in a parameter file."""


def check_parameter_file(path: str | Path) -> None:
    """Check a parameter file as the nodes will, before any of them is started.

    Raises
    ------
    ParameterError
        If the file, a key or a parameter is wrong, or the controller has a list for another number of axes than the
        machine has; one line that names the file.
    """
    parameters = {node: load_parameters(model, path, node) for node, model in PARAMETERS.items()}
    simulator = parameters["simulator"]
    assert isinstance(simulator, SimulatorParameters)
    axes = len(machine_of(simulator).axes)
    try:
        for controller in parameters.values():
            if isinstance(controller, PdControllerParameters | StateSpaceControllerParameters):
                controller.require_axes(axes)
    except ParameterError as problem:
        raise ParameterError(f"{path}: {problem}") from None


def require_emulated_target(path: str | Path) -> None:
    """Refuse a parameter file whose bridge would command another target than the one that is emulated here.

    Raises
    ------
    ParameterError
        If the link of the bridge leads to another machine, or to a device.
    """
    bridge = load_parameters(BridgeParameters, path, "hardware_bridge")
    emulator = load_parameters(TargetEmulatorParameters, path, "target_emulator")
    address, kind = bridge.link.address, bridge.link.kind
    serial = address.startswith("serial:")
    here = address.startswith("127.") or address in ("localhost", emulator.address)
    if kind == "amb_udp" and not here and not (serial and emulator.address.startswith("serial:")):
        raise ParameterError(
            f"{path}: hardware_bridge: link.address = {address!r} is not allowed with an emulated target, which is at "
            f"{emulator.address}; the bridge would command another one"
        )
