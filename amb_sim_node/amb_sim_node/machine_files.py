"""The machine of a parameter file, described by its blocks of simulator and controller, for nodes of other names."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from amb_core.errors import ParameterError
from amb_core.files.package_files import located
from amb_core.files.parameter_files import ParameterFile
from amb_core.loop.control import ControllerParameters
from amb_core.parameters import load_parameters, own_declarations
from amb_core.plant import PlantParameters


def machine_file(given: str, arguments: Sequence[str], namespace: str) -> str:
    """The file that describes the machine; empty for the defaults.

    Parameters
    ----------
    given : str
        The node's parameter; empty for the last file among the arguments that has parameters of a plant.
    arguments : sequence of str
        Of the process; files follow `--params-file`.
    namespace : str
        Of the nodes in the file.

    Raises
    ------
    ParameterError
        If a file cannot be read or is no parameter file.
    """
    if given:
        try:
            return str(located(given))
        except OSError as problem:
            raise ParameterError(f"parameter file {given}: {problem.strerror}") from None
    for file in reversed(_files(arguments)):
        values = ParameterFile(file).values(f"{namespace}/simulator")
        if any(name.split(".")[0] in PlantParameters.model_fields for name in values):
            return file
    return ""


def machine_parameters(file: str, namespace: str) -> tuple[PlantParameters, ControllerParameters]:
    """Plant and controller of a parameter file; the defaults for an empty name.

    Raises
    ------
    ParameterError
        If the file cannot be read, or a parameter in it is wrong.
    """
    if not file:
        return PlantParameters(), ControllerParameters()
    plant = load_parameters(PlantParameters, file, f"{namespace}/simulator", part=True)
    return plant, load_parameters(ControllerParameters, file, f"{namespace}/pd_controller", part=True)


def gains_in(arguments: Sequence[str], namespace: str) -> dict[str, Any]:
    """Parameters of the PD law in the block of pd_controller of the files among the arguments; the last one wins.

    Raises
    ------
    ParameterError
        If a file cannot be read or is no parameter file.
    """
    found: dict[str, Any] = {}
    for file in _files(arguments):
        found |= ParameterFile(file).values(f"{namespace}/pd_controller")
    own = {declaration.name for declaration in own_declarations(ControllerParameters)}
    return {name: value for name, value in found.items() if name in own}


def _files(arguments: Sequence[str]) -> list[str]:
    return [file for flag, file in pairwise(arguments) if flag == "--params-file"]
