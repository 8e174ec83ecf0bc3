"""What a bag has for a validation: the data, and the parameters of the controller and of the simulated plant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_core.analysis.data_files import read_data
from amb_core.files.regular_files import is_folder
from amb_core.identification.data import IdentificationData

if TYPE_CHECKING:
    from amb_core.loop.control import ControllerParameters
    from amb_core.plant import PlantParameters

SIMULATOR_NODE = "simulator"
_FILES = (".csv", ".npz", ".mat")


@dataclass(frozen=True, eq=False)
class RecordedLoop:
    """Data of a loop, and what is known of the loop.

    Attributes
    ----------
    data : IdentificationData
        The data.
    controller : ControllerParameters or None
        The controller; None where it was not recorded.
    plant : PlantParameters or None
        The simulated plant; None where it was not recorded, as for a real bearing.
    damage : str
        Why a bag does not read to its end; empty for a whole one.
    """

    data: IdentificationData
    controller: ControllerParameters | None
    plant: PlantParameters | None
    damage: str = ""


def read_loop(path: str | Path, **options: Any) -> RecordedLoop:
    """Read a bag, or a file of data alone.

    Parameters
    ----------
    path : path
        As for `read_data`.
    **options
        Those of `read_data`.

    Raises
    ------
    BagError, IdentificationError
        If there are no such data.
    ParameterError
        If a recorded parameter is out of its range.
    """
    path = Path(path)
    data = read_data(path, **options)
    if path.suffix.lower() in _FILES and not is_folder(path):
        return RecordedLoop(data, None, None)
    from amb_core.recording import read_bag

    bag = read_bag(path)
    nodes = {node.rsplit("/", 1)[-1]: values for node, values in bag.parameters().items()}
    plant = None
    if SIMULATOR_NODE in nodes:
        from amb_core.parameters import part_of
        from amb_core.plant import PlantParameters

        plant = part_of(PlantParameters, nodes[SIMULATOR_NODE])
    return RecordedLoop(data, bag.controller_parameters(), plant, bag.truncated)
