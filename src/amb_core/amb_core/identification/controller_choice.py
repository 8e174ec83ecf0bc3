"""The controller of an experiment: recorded, running, or named by the user; it is an error if none is known."""

from __future__ import annotations

from pathlib import Path

from amb_core.errors import IdentificationError, ParameterError
from amb_core.files.parameter_files import ParameterFile
from amb_core.identification.data import IdentificationData
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import ControllerFileParameters, KnownController, LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.parameters import declarations, load_parameters, part_of

PAPER = "paper"
CONTROLLER_NODE, LINEAR_CONTROLLER_NODE = "pd_controller", "state_space_controller"
_PARAMETER_FILES = (".yaml", ".yml")
_CONTROLLER_FILES = (".json", ".npz", ".mat")
ALLOWED = f"{PAPER}, a ROS parameter file (.yaml), or a state-space controller ({', '.join(_CONTROLLER_FILES)})"
"""What `named_controller` takes, as text."""


def is_named_set(name: str) -> bool:
    """Whether a name denotes a controller, and not the node that has one."""
    return name == PAPER or name.lower().endswith((*_PARAMETER_FILES, *_CONTROLLER_FILES))


def named_controller(
    name: str,
    node: str = CONTROLLER_NODE,
    sample_rate: float | None = None,
    current_limit: float | None = None,
) -> KnownController:
    """The controller that a user names.

    Parameters
    ----------
    name : str
        `paper` for that of the paper's table 1; a ROS parameter file (.yaml or .yml), of a PD controller or of a
        linear one that names its file; or the file of a state-space controller (.json, .npz or .mat).
    node : str
        Name of the PD controller's section in a parameter file.
    sample_rate : float, optional
        That of the data (Hz); by default 10 kHz, or that of the simulator in the file.
    current_limit : float, optional
        Limit of the currents (A), which the file of a state-space controller does not hold; by default 3 A.

    Raises
    ------
    IdentificationError
        If the name is neither.
    ParameterError
        If the file cannot be read, holds a wrong parameter, or is for another sample rate.
    """
    if not is_named_set(name):
        raise IdentificationError(f"controller = {name!r} is not allowed; allowed: {ALLOWED}")
    if name == PAPER:
        found: KnownController = ControllerParameters()
    elif name.lower().endswith(_CONTROLLER_FILES):
        limit = {} if current_limit is None else {"current_limit": current_limit}
        found = LinearControl.load(name, part_of(LinearControllerParameters, limit))
    else:
        found = _linear_of(name, node) or load_parameters(ControllerParameters, name, node, part=True)
    return found if sample_rate is None else found.at_rate(sample_rate)


def _linear_of(path: str, node: str) -> LinearControl | None:
    """The linear controller that a parameter file names; None if it has none."""
    settings = load_parameters(ControllerFileParameters, path, LINEAR_CONTROLLER_NODE, part=True)
    if not settings.controller_file:
        return None
    of_pd = {item.name for item in declarations(ControllerParameters)}
    of_linear = {item.name for item in declarations(ControllerFileParameters)}
    if node != LINEAR_CONTROLLER_NODE and (of_pd - of_linear) & set(ParameterFile(path).values(node)):
        raise ParameterError(
            f"parameter file {path} has two controllers, {node} and {LINEAR_CONTROLLER_NODE}; name the file of the "
            "linear one itself, or a parameter file with one of them"
        )
    file = Path(settings.controller_file)
    beside = Path(path).parent / file
    parameters = part_of(LinearControllerParameters, settings.model_dump())
    return LinearControl.load(beside if not file.exists() and beside.exists() else file, parameters)


def needs_controller(data: IdentificationData) -> bool:
    """Whether the data come from the closed loop of a machine: currents in A and positions in m.

    Those of two axes always do. Others do if each current has the name of its axis: i_x_a for x_a.
    """
    axes = len(data.output_names)
    if data.input_units != ("A",) * axes or data.output_units != ("m",) * axes:
        return False
    return axes == 2 or data.input_names == tuple(f"i_{name}" for name in data.output_names)
