"""The controller of an experiment: recorded, running, or named by the user; it is an error if none is known."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks.samples import cut_samples
from amb_core.ground.errors import IdentificationError, ParameterError
from amb_core.ground.files.parameter_files import ParameterFile
from amb_core.ground.given_values import number, refusal, require_kind
from amb_core.ground.parameters import declarations, load_parameters, part_of, validate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import UNLIMITED, ControllerFileParameters, KnownController, LinearControl, limited
from amb_core.loop.linear_control import LinearControllerParameters

PAPER = "paper"
NO_CONTROLLER = "none"
"""Name that stands for no controller: the closed loop is left out."""
PD = "pd:"
_FEWEST_CUT = 3  # currents at a limit
CONTROLLER_NODE, LINEAR_CONTROLLER_NODE = "pd_controller", "state_space_controller"
_PARAMETER_FILES = (".yaml", ".yml")
_CONTROLLER_FILES = (".json", ".npz", ".mat")
ALLOWED = (
    f"{PAPER}, {PD}K_P,K_D in A/m and A s/m with the derivative on the error ({PD}K_P,K_D,measurement for that on the "
    "measured position), a ROS parameter file (.yaml), or a state-space controller "
    f"({', '.join(_CONTROLLER_FILES)} of A, B, C, D, Ts)"
)
"""What `named_controller` takes, as text."""


def is_named_set(name: str) -> bool:
    """Whether a name denotes a controller, and not the node that has one."""
    return name == PAPER or name.startswith(PD) or name.lower().endswith((*_PARAMETER_FILES, *_CONTROLLER_FILES))


def named_controller(
    name: str | Path,
    node: str = CONTROLLER_NODE,
    sample_rate: float | None = None,
) -> KnownController:
    """The controller that a user names.

    Neither gains nor the file of a state-space controller hold a limit of the currents; see `limited`.

    Parameters
    ----------
    name : str or Path
        `paper` for that of the paper's table 1; `pd:K_P,K_D` for a PD controller of these gains (A/m, A s/m) with the
        derivative on the position error, `pd:K_P,K_D,measurement` for one with the derivative on the measured position;
        a ROS parameter file (.yaml or .yml), of a PD controller or of a
        linear one that names its file; or the file of a state-space controller (.json, .npz or .mat).
    node : str
        Name of the PD controller's section in a parameter file.
    sample_rate : float, optional
        That of the data (Hz); by default 10 kHz, or that of the simulator in the file.

    Raises
    ------
    IdentificationError
        If the name is none of these.
    ParameterError
        If the file cannot be read, holds a wrong parameter, or is for another sample rate.
    """
    name = os.fspath(name) if isinstance(name, os.PathLike) else name
    if not isinstance(name, str) or not is_named_set(name):
        raise refusal("controller", name, ALLOWED, IdentificationError)
    require_kind("node", node, str, "the name of a node", IdentificationError)
    if sample_rate is not None:
        sample_rate = number("sample_rate", sample_rate, ParameterError)
        if not 0.0 < sample_rate < math.inf:
            raise refusal("sample_rate", sample_rate, "more than 0 Hz, finite", ParameterError)
    if name == PAPER:
        controller: KnownController = ControllerParameters()
    elif name.startswith(PD):
        controller = _of_gains(name)
    elif name.lower().endswith(_CONTROLLER_FILES):
        controller = LinearControl.load(name)
    else:
        controller = _linear_of(name, node) or load_parameters(ControllerParameters, name, node, part=True)
    return controller if sample_rate is None else controller.at_rate(sample_rate)


def with_shown_limit(controller: KnownController, data: IdentificationData) -> KnownController:
    """A controller of data; if its limit is not known, with the one that their currents show."""
    return limited(controller, shown_limit(data)) if controller.current_limit >= UNLIMITED else controller


def shown_limit(data: IdentificationData) -> float | None:
    """Limit at which the recorded currents are cut (A): their largest magnitude, if they have a flat top there.

    Parameters
    ----------
    data : IdentificationData
        Data of a loop.

    Returns
    -------
    float or None
        The limit; None where nothing is cut, or the inputs are no currents.
    """
    if not suits_controller(data):
        return None
    currents = np.vstack([item.inputs for item in data.experiments]) + data.input_offset
    largest = float(np.abs(currents).max())
    at_limit = np.abs(currents) >= largest * (1.0 - 1e-9)
    columns = np.flatnonzero(at_limit.sum(axis=0) >= _FEWEST_CUT)
    cut = any(np.any(cut_samples(currents[:, column]) & at_limit[:, column]) for column in columns)
    return largest if cut and 0.0 < largest < UNLIMITED else None


def _of_gains(name: str) -> ControllerParameters:
    """The PD controller `pd:K_P,K_D` or `pd:K_P,K_D,SIGNAL`: error, which is the default, or measurement."""
    words = name.removeprefix(PD).split(",")
    try:
        gains = {"proportional_gain": float(words[0]), "derivative_gain": float(words[1])}
    except (ValueError, IndexError):
        raise IdentificationError(
            f"controller = {name!r} is not allowed; it must be such as {PD}20000,38 or {PD}20000,38,measurement: "
            "K_P in A/m, K_D in A s/m, and the signal that is derived"
        ) from None
    derived = {"derivative_on": words[2]} if len(words) == 3 else {}
    if len(words) > 3:
        raise IdentificationError(f"controller = {name!r} is not allowed; it must be such as {PD}20000,38,measurement")
    return validate(ControllerParameters, {**gains, **derived, "current_limit": UNLIMITED})


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


def suits_controller(data: IdentificationData) -> bool:
    """Whether the data have as many inputs in A as outputs in m, as the loop of a bearing has."""
    axes = len(data.output_names)
    return data.input_units == ("A",) * axes and data.output_units == ("m",) * axes


def needs_controller(data: IdentificationData) -> bool:
    """Whether the data come from the closed loop of a machine: currents in A and positions in m.

    Those of two axes always do, and those of others' files. Others do if each current has the name of its axis: i_x_a
    for x_a.
    """
    if not suits_controller(data):
        return False
    names = tuple(f"i_{name}" for name in data.output_names)
    return data.foreign or len(names) == 2 or data.input_names == names
