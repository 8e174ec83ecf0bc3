"""The data and models that every step takes: from a record to a read file, from a model to its identification."""

from __future__ import annotations

from typing import Protocol, TypeAlias

from amb_core.data.experiments import IdentificationData, RecordedLoop
from amb_core.ground.errors import IdentificationError
from amb_core.identification.progress import SearchEnd
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord


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


def _kind(value: object) -> str:
    shape = getattr(value, "shape", None)
    return f"{type(value).__name__}{'' if shape is None else f' of shape {shape}'}"
