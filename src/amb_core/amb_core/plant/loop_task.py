"""A task on a plant in the loop of its controller: what determines its result."""

from __future__ import annotations

from typing import Any, TypeVar

from amb_core.ground.parameters import part_of
from amb_core.ground.tasks.provenance import code_version
from amb_core.ground.tasks.task import Task
from amb_core.loop.control import ControllerParameters
from amb_core.plant.data_files import file_checksums
from amb_core.plant.parameters import PlantParameters

R = TypeVar("R")


class LoopTask(Task[R]):
    """A task that is a frozen dataclass with the fields `plant` and `controller`, and more of its own.

    Subclasses of their parameters (those of nodes) are reduced to these, so that the same loop is the same task.
    """

    plant: PlantParameters
    controller: ControllerParameters

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", part_of(PlantParameters, self.plant.model_dump()))
        object.__setattr__(self, "controller", part_of(ControllerParameters, self.controller.model_dump()))

    def describe(self) -> dict[str, Any]:
        """What determines the result, as plain JSON values: parameters, files they name, version of the code.

        Returns
        -------
        dict of str to object
            JSON values by name, to which subclasses add their own.
        """
        return {
            "plant": self.plant.model_dump(mode="json"),
            "controller": self.controller.model_dump(mode="json"),
            "files": file_checksums(self.plant),
            "code": code_version(),
        }
