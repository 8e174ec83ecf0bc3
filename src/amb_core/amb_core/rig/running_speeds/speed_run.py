"""The experiment at one running speed: simulated, and a model identified. The unit of work, and of the cache."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from amb_core.designs.excitation.excited_order import determined_order
from amb_core.excitation import generate
from amb_core.ground.errors import IdentificationError, PlantError
from amb_core.identification import IdentificationData, identify
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.loop_task import LoopTask
from amb_core.plant.simulation import simulate
from amb_core.rig.running_speeds.settings import SpeedSettings


@dataclass(frozen=True)
class SpeedTask(LoopTask[StateSpaceModel]):
    """Everything that determines the model of one running speed.

    Attributes
    ----------
    settings : SpeedSettings
        The experiment.
    plant : PlantParameters
        The machine; its `rotor.running_speed` is the speed.
    controller : ControllerParameters
        Gains of the loop.
    """

    settings: SpeedSettings
    plant: PlantParameters
    controller: ControllerParameters

    def describe(self) -> dict[str, Any]:
        """What determines the result, as plain JSON values: parameters, files they name, version of the code.

        Returns
        -------
        dict of str to object
            JSON values by name.
        """
        return super().describe() | {"settings": self.settings.model_dump()}

    def run(self) -> StateSpaceModel:
        """Simulate the experiment and identify a model; see `run_speed`.

        Returns
        -------
        StateSpaceModel
            The identified model.
        """
        return run_speed(self)

    @staticmethod
    def to_json(result: StateSpaceModel, /) -> dict[str, Any]:
        """The model as JSON values.

        Parameters
        ----------
        result : StateSpaceModel
            The model.

        Returns
        -------
        dict of str to object
            JSON values by field name.
        """
        return result.to_json()

    @staticmethod
    def from_json(entry: dict[str, Any], /) -> StateSpaceModel:
        """The model that `to_json` wrote.

        Parameters
        ----------
        entry : dict of str to object
            JSON values.

        Returns
        -------
        StateSpaceModel
            The model.

        Raises
        ------
        ValueError
            If they are not those of a model of this version.
        """
        try:
            return StateSpaceModel.from_json(entry)
        except IdentificationError as problem:  # of another version; the task is run again
            raise ValueError(str(problem)) from None


def run_speed(task: SpeedTask) -> StateSpaceModel:
    """Simulate the loop without ROS under an orthogonal multisine, and identify the plant.

    Raises
    ------
    PlantError, ExcitationError
        If the plant or the excitation cannot be made, or the rotor touches its backup bearing.
    IdentificationError
        If the data determine no model.
    """
    plant = Plant(task.plant)
    axes = len(plant.machine.axes)
    signal = generate(task.settings.multisine(task.plant, plant.machine), plant.machine.sample_rate, plant.machine)
    rest = round(task.settings.settling * plant.machine.sample_rate)
    record = simulate(plant, PdController(task.controller, axes), rest + signal.steps, signal.samples, rest)
    rpm = 60.0 * task.plant.rotor.running_speed
    if record.steps < rest + signal.steps:
        raise PlantError(f"at {rpm:.0f} rpm the rotor delevitates after {record.steps * record.sample_time:.3g} s")
    data = IdentificationData.from_record(record.window(rest, signal.steps), source=f"{rpm:.0f} rpm")
    wanted = task.settings.model_order(task.plant)
    order = wanted if task.settings.order else max(1, determined_order(data, wanted))
    return identify(data, order, controller=task.controller).model
