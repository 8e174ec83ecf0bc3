"""Parameter files among the arguments of a process, and the gains of the PD law in them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from amb_core.ground.files.parameter_files import ParameterFile, known_in
from amb_core.ground.parameters import own_declarations
from amb_core.loop.pd_parameters import ControllerParameters


def gains_in(arguments: Sequence[str], namespace: str) -> dict[str, Any]:
    """Parameters of the PD law in the block of pd_controller of the files among the arguments; the last one wins.

    Raises
    ------
    ParameterError
        If a file cannot be read or is no parameter file.
    """
    parameters: dict[str, Any] = {}
    for file in files_among(arguments):
        parameters |= ParameterFile(file, known_in(namespace)).values(f"{namespace}/pd_controller")
    own = {declaration.name for declaration in own_declarations(ControllerParameters)}
    return {name: value for name, value in parameters.items() if name in own}


def files_among(arguments: Sequence[str]) -> list[str]:
    """Those that follow `--params-file`, in order."""
    return [file for flag, file in pairwise(arguments) if flag == "--params-file"]
