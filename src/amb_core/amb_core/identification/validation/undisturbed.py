"""Prediction errors without tones that the reference lacks: disturbances that say nothing of the plant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.tones import find_tones, standing_out
from amb_core.linear.model.state_space import StateSpaceModel

Arrays = NDArray[np.float64]

_FADED = 1e-4  # of its start, that is left of a transient of the predictor


@dataclass(frozen=True)
class Tone:
    """A tone of the prediction errors.

    Attributes
    ----------
    frequency : float
        Its frequency (Hz).
    share : float
        What it has of the variance of the errors, of the output in which that is most (-).
    """

    frequency: float
    share: float


@dataclass(frozen=True)
class Undisturbed:
    """Prediction errors of an experiment without tones that its reference lacks.

    Attributes
    ----------
    first : int
        Sample of the experiment with which they begin: at its start the predictor answers to a tone with a transient.
    errors : ndarray, shape (steps, p)
        The errors from there on.
    tones : tuple of Tone
        The tones, the strongest first.
    """

    first: int
    errors: Arrays
    tones: tuple[Tone, ...]


def undisturbed(model: StateSpaceModel, errors: Arrays, reference: Arrays | None) -> Undisturbed:
    """Prediction errors of an experiment, shape (steps, p), without tones.

    Without a reference a tone cannot be told from what the model does not follow, and stays.
    """
    if reference is None or not find_tones(errors, standing_out(reference)).frequencies:
        return Undisturbed(0, errors, ())
    radius = float(np.abs(np.linalg.eigvals(model.a - model.k @ model.c)).max(initial=0.0))
    memory = math.ceil(math.log(_FADED) / math.log(radius)) if radius > 0.0 else 1
    first = min(memory, len(errors) // 4)
    tones_of_errors = find_tones(errors[first:], standing_out(reference[first:]))
    tones = zip(tones_of_errors.frequencies, tones_of_errors.shares, strict=True)
    return Undisturbed(
        first, tones_of_errors.rest, tuple(Tone(each / model.sample_time, share) for each, share in tones)
    )
