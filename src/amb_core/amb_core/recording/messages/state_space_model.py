"""amb_msgs/StateSpaceModel: an identified model, bit for bit."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from amb_core.ground.errors import BagError
from amb_core.linear.model import StateSpaceModel
from amb_core.recording.messages.arrays import doubles

M = TypeVar("M", bound=Any)

STATE_SPACE_MODEL = "amb_msgs/msg/StateSpaceModel"
_ARRAYS = (
    "a", "b", "c", "d", "k", "innovation_covariance", "input_offset", "output_offset", "initial_state", "fit",
    "fingerprint", "search",
)  # fmt: skip


def model_from_message(message: Any) -> StateSpaceModel:
    """The model of a StateSpaceModel message.

    Raises
    ------
    BagError
        If its arrays do not have the sizes that it states.
    IdentificationError
        If a value is not finite.
    """
    n, m, p = int(message.order), int(message.inputs), int(message.outputs)
    shapes = {"a": (n, n), "b": (n, m), "c": (p, n), "d": (p, m), "k": (n, p), "innovation_covariance": (p, p)}
    try:
        matrices = {name: np.asarray(getattr(message, name)).reshape(shape) for name, shape in shapes.items()}
    except ValueError as problem:
        raise BagError(f"model of order {n} with {m} inputs and {p} outputs: {problem}") from None
    return StateSpaceModel(
        **matrices,
        input_offset=np.asarray(message.input_offset),
        output_offset=np.asarray(message.output_offset),
        initial_state=np.asarray(message.initial_state),
        sample_time=float(message.sample_time),
        input_names=tuple(message.input_names),
        output_names=tuple(message.output_names),
        input_units=tuple(getattr(message, "input_units", ())),  # missing in old bags
        output_units=tuple(getattr(message, "output_units", ())),
        method=str(message.method),
        source=str(message.source),
        samples=int(message.samples),
        fit=np.asarray(message.fit),
        fingerprint=np.asarray(getattr(message, "fingerprint", ())),
        search=np.asarray(getattr(message, "search", ())),
        undecided=tuple(getattr(message, "undecided", ())),
    )


def fill_model(message: M, model: StateSpaceModel) -> M:
    """Set the fields of a StateSpaceModel message to a model; matrices become row-major arrays."""
    message.order, message.inputs, message.outputs = model.order, len(model.input_names), len(model.output_names)
    message.sample_time, message.samples = model.sample_time, model.samples
    message.method, message.source = model.method, model.source
    for name in ("input_names", "output_names", "input_units", "output_units", "undecided"):
        setattr(message, name, list(getattr(model, name)))
    for name in _ARRAYS:
        setattr(message, name, doubles(getattr(model, name)))
    return message
