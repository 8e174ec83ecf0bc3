"""A model in closed loop over the experiments of a data set, each from its own initial state and operating point."""

from __future__ import annotations

from dataclasses import replace

from amb_core.data.experiments import IdentificationData
from amb_core.identification.closed_loop import simulate_closed_loop
from amb_core.identification.controller_state import start_of
from amb_core.identification.prediction import first_state
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord


def simulate_experiment(
    model: StateSpaceModel, data: IdentificationData, index: int, controller: KnownController
) -> LoopRecord:
    """Simulate model and controller under the reference of an experiment.

    Parameters
    ----------
    model : StateSpaceModel
        A model of these data or of others; its offsets are those of the data before detrending.
    data : IdentificationData
        The data.
    index : int
        Experiment, whose reference must be known.
    controller : KnownController
        Its controller.

    Raises
    ------
    IdentificationError
        If the experiment is not one of the loop (see `IdentificationData.record`), or controller and model differ.
    DivergenceError
        If the simulation diverges.
    """
    record = data.record(index)
    model = in_experiment(model, data, index)
    return simulate_closed_loop(model, controller, record.reference, record.first_step, start_of(controller, record))


def in_experiment(model: StateSpaceModel, data: IdentificationData, index: int) -> StateSpaceModel:
    """The model about the operating point of an experiment, in the initial state that predicts its outputs best."""
    own = data.subset([index])
    model = replace(
        model,
        input_offset=model.input_offset - data.input_offset + own.input_offset,
        output_offset=model.output_offset - data.output_offset + own.output_offset,
    )
    item = data.experiments[index]
    inputs = item.inputs - (model.input_offset - own.input_offset)
    outputs = item.outputs - (model.output_offset - own.output_offset)
    return replace(model, initial_state=first_state(model, inputs, outputs))
