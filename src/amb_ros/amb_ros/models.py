"""Identified models as messages, bit for bit; `amb_core.recording.messages.model_from_message` is the way back."""

from __future__ import annotations

from array import array

import numpy as np
from builtin_interfaces.msg import Time

from amb_core.identification import StateSpaceModel
from amb_msgs.msg import StateSpaceModel as StateSpaceModelMessage

_VECTORS = ("a", "b", "c", "d", "k", "innovation_covariance", "input_offset", "output_offset", "initial_state", "fit")


def model_to_message(model: StateSpaceModel, stamp: Time) -> StateSpaceModelMessage:
    """The message of a model; matrices become row-major arrays."""
    message = StateSpaceModelMessage(
        order=model.order,
        inputs=len(model.input_names),
        outputs=len(model.output_names),
        sample_time=model.sample_time,
        input_names=list(model.input_names),
        output_names=list(model.output_names),
        input_units=list(model.input_units),
        output_units=list(model.output_units),
        method=model.method,
        source=model.source,
        samples=model.samples,
    )
    message.header.stamp = stamp
    for name in _VECTORS:
        setattr(message, name, array("d", np.ascontiguousarray(getattr(model, name), dtype=np.float64).tobytes()))
    return message
