"""What every step takes: data from a record to a read file, a model or its identification, a controller of any kind."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol, TypeAlias, TypeGuard, overload

import numpy as np

from amb_core.data.controller_choice import named_controller, with_shown_limit
from amb_core.data.experiments import IdentificationData, RecordedLoop
from amb_core.data.experiments.dataset import require_data
from amb_core.ground.errors import IdentificationError, ParameterError
from amb_core.ground.given_values import kind_of
from amb_core.identification.progress import SearchEnd
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty
from amb_core.linear import LinearSystem
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.sampling import discretised
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.records import LoopRecord, sample_rate_of

if TYPE_CHECKING:
    import control


class Identified(Protocol):
    """The result of an identification, as later steps use it; see `Identification`."""

    @property
    def model(self) -> StateSpaceModel:
        """The model."""

    @property
    def data(self) -> IdentificationData:
        """The data that it was identified from."""

    @property
    def controller(self) -> KnownController | None:
        """The controller of the loop; None if it is not known."""

    @property
    def uncertainty(self) -> ModelUncertainty | None:
        """How accurately the data determine the model; None if that is not known."""

    @property
    def search(self) -> SearchEnd | None:
        """How the search ended; None without one."""


Model: TypeAlias = "StateSpaceModel | Identified | LinearSystem | control.StateSpace"
"""A model, the result of its identification, or a plant of one's own, from currents to positions, that has no noise."""
Data: TypeAlias = LoopRecord | IdentificationData | RecordedLoop
"""Data of a loop: simulated, from arrays, or from a file or bag with what is known of it."""
Controller: TypeAlias = "KnownController | LinearSystem | control.StateSpace | str"
"""Parameters of the PD law, a linear law, a design of python-control, or a name as `named_controller` takes."""

OF_UNCERTAINTY = "what estimate_uncertainty returns, or None"
"""What every step takes as the uncertainty of a model, as text."""


def is_identified(model: Model) -> TypeGuard[Identified]:
    """Whether it is the result of an identification."""
    return hasattr(model, "uncertainty")


def given_loop(data: Data) -> RecordedLoop:
    """The data with the controller and plant that are known of them.

    Raises
    ------
    IdentificationError
        If they are something else.
    """
    if isinstance(data, RecordedLoop):
        require_data(data.data)
        if data.controller is not None and not isinstance(data.controller, ControllerParameters | LinearControl):
            raise ParameterError(
                f"controller of the data: {kind_of(data.controller)} is not allowed; allowed: ControllerParameters, "
                "LinearControl, or None"
            )
        return data
    if isinstance(data, IdentificationData):
        return RecordedLoop(data, None)
    if isinstance(data, LoopRecord):
        return RecordedLoop(IdentificationData.from_record(data), None)
    raise IdentificationError(
        f"data: {kind_of(data)} is not allowed; allowed: what amb_core.read returns for a file or bag, a LoopRecord, "
        "or IdentificationData; arrays: IdentificationData.from_arrays(inputs, outputs, sample_time)"
    )


def given_model(model: Model, data: IdentificationData | None = None) -> StateSpaceModel:
    """The model itself; of a plant of one's own the model about the means of the data, without a gain.

    Parameters
    ----------
    model : StateSpaceModel, Identified, LinearSystem or control.StateSpace
        As `Model`. A plant in continuous time is taken with inputs held over the samples of the data.
    data : IdentificationData, optional
        Data of the loop, which give a plant its operating point, and names and units where it has none.

    Raises
    ------
    IdentificationError
        If it is something else, or a plant does not suit the data or comes without any.
    """
    inner = model.model if is_identified(model) else model
    if isinstance(inner, StateSpaceModel):
        return inner
    if isinstance(inner, LinearSystem) or hasattr(inner, "A"):
        plant = inner if isinstance(inner, LinearSystem) else _without_counted_names(LinearSystem.from_control(inner))
        if data is None:
            raise IdentificationError(
                f"model: {kind_of(model)} has no operating point of its own; give data of its loop"
            )
        return _about_means(plant, data)
    raise IdentificationError(
        f"model: {kind_of(model)} is not allowed; allowed: the result of identify, a StateSpaceModel, a LinearSystem, "
        "or a state-space system of python-control; files: StateSpaceModel.load(path)"
    )


def _without_counted_names(plant: LinearSystem) -> LinearSystem:
    """Without the names u[0], y[0] that python-control gives where there are none."""
    given = (plant.input_names, plant.output_names)
    counted = [all(re.fullmatch(r"\w\[\d+\]", name) for name in names) for names in given]
    inputs, outputs = (() if of_its_own else names for names, of_its_own in zip(given, counted, strict=True))
    return LinearSystem(plant.a, plant.b, plant.c, plant.d, plant.sample_time, inputs, outputs)


def _about_means(plant: LinearSystem, data: IdentificationData) -> StateSpaceModel:
    """A plant as a model without a gain whose operating point are the means of the data."""
    here, there = (len(data.input_names), len(data.output_names)), (plant.inputs, plant.outputs)
    if here != there:
        raise IdentificationError(
            f"the data have {here[0]} inputs and {here[1]} outputs, the model {there[0]} and {there[1]}"
        )
    sampled = plant if plant.sample_time else discretised(plant, data.sample_time)
    n, p = len(sampled.a), sampled.outputs
    inputs, outputs = (np.vstack([getattr(item, kind) for item in data.experiments]) for kind in ("inputs", "outputs"))
    return StateSpaceModel(
        sampled.a, sampled.b, sampled.c, sampled.d, np.zeros((n, p)), np.zeros((p, p)),
        np.nanmean(inputs, axis=0), np.nanmean(outputs, axis=0), np.zeros(n), sampled.sample_time,
        input_names=plant.input_names or data.input_names, output_names=plant.output_names or data.output_names,
        input_units=plant.input_units or data.input_units, output_units=plant.output_units or data.output_units,
        method="given",
    )  # fmt: skip


@overload
def given_controller(
    controller: Controller, sample_time: float, data: IdentificationData | None = None
) -> KnownController: ...
@overload
def given_controller(
    controller: Controller | None, sample_time: float, data: IdentificationData | None = None
) -> KnownController | None: ...
def given_controller(
    controller: Controller | None, sample_time: float, data: IdentificationData | None = None
) -> KnownController | None:
    """The controller itself; None for none.

    Parameters
    ----------
    controller : KnownController, LinearSystem, control.StateSpace, str or None
        As `Controller`.
    sample_time : float
        That of the data or of the model (s), for which one that is named or designed has to be made.
    data : IdentificationData, optional
        Data of its loop, which show a limit of the currents that is not known otherwise; by default there is none.

    Raises
    ------
    IdentificationError, ParameterError
        If it is something else, cannot be read, or is made for another sample time.
    """
    if controller is None:
        return None
    law = _known(controller, sample_rate_of(sample_time))
    return law if data is None else with_shown_limit(law, data)


def required_controller(controller: Controller, sample_time: float) -> KnownController:
    """As `given_controller`, where a controller is needed."""
    return _known(controller, sample_rate_of(sample_time))


def _known(controller: Controller, sample_rate: float) -> KnownController:
    if isinstance(controller, ControllerParameters | LinearControl):
        return controller
    if isinstance(controller, str):
        return named_controller(controller, sample_rate=sample_rate)
    if isinstance(controller, LinearSystem) or hasattr(controller, "A"):
        return LinearControl.of(controller).at_rate(sample_rate)
    raise ParameterError(
        f"controller: {kind_of(controller)} is not allowed; allowed: ControllerParameters, LinearControl, "
        "LinearSystem, a state-space system of python-control from position errors to currents, or a name "
        "(pd:20000,38, law.mat)"
    )
