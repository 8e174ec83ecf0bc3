"""Inputs of commands: parameter files and values.

Nodes are imported where their parameters are read: most commands that name a file of parameters need none.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import yaml

from amb_bringup.graph.packages import share_folder
from amb_core.ground.errors import IdentificationError
from amb_core.ground.parameters import Parameters, load_parameters

if TYPE_CHECKING:
    from amb_core.loop.control import ControllerParameters
    from amb_core.plant import PlantParameters
    from amb_core.regions import RegionParameters

P = TypeVar("P", bound="Parameters")


def parameter_file(params: Path | None) -> Path:
    """The requested parameter file, or that of the paper's bearing."""
    return params or share_folder("amb_bringup") / "config" / "paper.yaml"


def load_loop(params: Path | None) -> tuple[PlantParameters, ControllerParameters]:
    """Plant and controller of a parameter file of all nodes; values that the nodes would refuse are refused."""
    from amb_controller_node.parameters import PdControllerParameters  # here, as help needs none of them
    from amb_core.loop.control import ControllerParameters
    from amb_core.plant import PlantParameters
    from amb_sim_node.parameters import SimulatorParameters

    path = parameter_file(params)
    return (
        _part(PlantParameters, SimulatorParameters, path, "simulator"),
        _part(ControllerParameters, PdControllerParameters, path, "pd_controller"),
    )


def load_regions(params: Path | None) -> RegionParameters:
    """Thresholds of the classifier in a parameter file of all nodes."""
    from amb_core.regions import RegionParameters
    from amb_ident_node.region_monitor_parameters import RegionMonitorParameters

    return _part(RegionParameters, RegionMonitorParameters, parameter_file(params), "region_monitor")


def _part(part: type[P], whole: type[Parameters], path: Path, node: str) -> P:
    """Some of the parameters of a node, after a check of all of them: a misspelt one belongs to no part."""
    load_parameters(whole, path, node)
    return load_parameters(part, path, node, part=True)


def inputs_of(*paths: Path) -> dict[str, str]:
    """SHA-256 of the files and bags that a result is made from, by their names."""
    from amb_core.robustness.hashes import sha256_of

    return {str(path): sha256_of(path) for path in paths}


def typed_value(word: str) -> Any:
    """A number if the word is one (YAML does not accept 1e-3 as one), a list of them in [], else a switch or a word."""
    if word.startswith("[") and word.endswith("]"):
        return [typed_value(item.strip()) for item in word[1:-1].split(",") if item.strip()]
    try:
        return float(word)
    except ValueError:
        return yaml.safe_load(word)


def model_order(text: str) -> int | Literal["auto"]:
    """The order of a model as --order takes it; IdentificationError if it is neither a number nor auto."""
    if text == "auto":
        return "auto"
    try:
        return int(text)
    except ValueError:
        raise IdentificationError(f"--order {text} is not allowed; it must be a number or auto") from None
