"""What every step takes: data from a record to a read file, a model or its identification, a controller of any kind."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeAlias, overload

from amb_core.data.controller_choice import named_controller, with_shown_limit
from amb_core.data.experiments import IdentificationData, RecordedLoop
from amb_core.ground.errors import IdentificationError, ParameterError
from amb_core.identification.progress import SearchEnd
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty
from amb_core.linear import LinearSystem
from amb_core.linear.model.state_space import StateSpaceModel
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


Model: TypeAlias = StateSpaceModel | Identified
"""A model, or the result of its identification."""
Data: TypeAlias = LoopRecord | IdentificationData | RecordedLoop
"""Data of a loop: simulated, from arrays, or from a file or bag with what is known of it."""
Controller: TypeAlias = "KnownController | LinearSystem | control.StateSpace | str"
"""Parameters of the PD law, a linear law, a design of python-control, or a name as `named_controller` takes."""


def given_loop(data: Data) -> RecordedLoop:
    """The data with the controller and plant that are known of them.

    Raises
    ------
    IdentificationError
        If they are something else.
    """
    if isinstance(data, RecordedLoop):
        return data
    if isinstance(data, IdentificationData):
        return RecordedLoop(data, None)
    if isinstance(data, LoopRecord):
        return RecordedLoop(IdentificationData.from_record(data), None)
    raise IdentificationError(
        f"data: {_kind(data)} is not allowed; allowed: what amb_core.read returns for a file or bag, a LoopRecord, or "
        "IdentificationData; arrays: IdentificationData.from_arrays(inputs, outputs, sample_time)"
    )


def given_model(model: Model) -> StateSpaceModel:
    """The model itself.

    Raises
    ------
    IdentificationError
        If it is something else.
    """
    inner = getattr(model, "model", model)
    if isinstance(inner, StateSpaceModel):
        return inner
    raise IdentificationError(
        f"model: {_kind(model)} is not allowed; allowed: the result of identify, or a StateSpaceModel; files: "
        "StateSpaceModel.load(path)"
    )


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


def _known(controller: Controller, sample_rate: float) -> KnownController:
    if isinstance(controller, ControllerParameters | LinearControl):
        return controller
    if isinstance(controller, str):
        return named_controller(controller, sample_rate=sample_rate)
    if isinstance(controller, LinearSystem) or hasattr(controller, "A"):
        return LinearControl.of(controller).at_rate(sample_rate)
    raise ParameterError(
        f"controller: {_kind(controller)} is not allowed; allowed: ControllerParameters, LinearControl, LinearSystem, "
        "a state-space system of python-control from position errors to currents, or a name (pd:20000,38, law.mat)"
    )


def _kind(value: object) -> str:
    shape = getattr(value, "shape", None)
    return f"{type(value).__name__}{'' if shape is None else f' of shape {shape}'}"
