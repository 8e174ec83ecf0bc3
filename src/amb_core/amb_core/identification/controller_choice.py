"""The controller of an experiment: recorded, running, or named by the user; it is an error if none is known."""

from __future__ import annotations

from amb_core.errors import IdentificationError
from amb_core.identification.data import IdentificationData
from amb_core.loop.control import ControllerParameters
from amb_core.parameters import load_parameters

PAPER = "paper"
CONTROLLER_NODE = "pd_controller"
_FILES = (".yaml", ".yml")


def is_named_set(name: str) -> bool:
    """Whether a name denotes a set of parameters, and not the node that has them."""
    return name == PAPER or name.lower().endswith(_FILES)


def named_controller(name: str, node: str = CONTROLLER_NODE, sample_rate: float | None = None) -> ControllerParameters:
    """The controller that a user names.

    Parameters
    ----------
    name : str
        `paper` for that of the paper's table 1, or a ROS parameter file (.yaml or .yml).
    node : str
        Name of the controller's section in such a file.
    sample_rate : float, optional
        That of the data (Hz); by default 10 kHz, or that of the simulator in the file.

    Raises
    ------
    IdentificationError
        If the name is neither.
    ParameterError
        If the file cannot be read or holds a wrong parameter.
    """
    if name == PAPER:
        return _at(ControllerParameters(), sample_rate)
    if not is_named_set(name):
        raise IdentificationError(
            f"controller = {name!r} is not allowed; allowed: {PAPER}, or a ROS parameter file ({', '.join(_FILES)})"
        )
    return _at(load_parameters(ControllerParameters, name, node, part=True), sample_rate)


def _at(controller: ControllerParameters, sample_rate: float | None) -> ControllerParameters:
    return controller if sample_rate is None else controller.at_rate(sample_rate)


def needs_controller(data: IdentificationData) -> bool:
    """Whether the data come from the closed loop of a machine: currents in A and positions in m.

    Those of two axes always do. Others do if each current has the name of its axis: i_x_a for x_a.
    """
    axes = len(data.output_names)
    if data.input_units != ("A",) * axes or data.output_units != ("m",) * axes:
        return False
    return axes == 2 or data.input_names == tuple(f"i_{name}" for name in data.output_names)
