"""The machine of a parameter file, described by its blocks of simulator and controller, for nodes of other names."""

from __future__ import annotations

from collections.abc import Sequence

from amb_core.ground.errors import ParameterError
from amb_core.ground.files.package_files import located
from amb_core.ground.files.parameter_files import ParameterFile, known_in
from amb_core.ground.parameters import load_parameters
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import PlantParameters
from amb_sim_node.gains import files_among


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
    for file in reversed(files_among(arguments)):
        values = ParameterFile(file, known_in(namespace)).values(f"{namespace}/simulator")
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
