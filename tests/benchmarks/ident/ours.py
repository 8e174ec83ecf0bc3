"""The methods of this project, as the benchmark calls them: inputs (A), outputs (m) to A, B, C."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from amb_core.identification import StateSpaceModel, pbsid, pem, ssarx

Arrays = NDArray[np.float64]


def _ours(inputs: Arrays, outputs: Arrays, sample_time: float, order: int) -> StateSpaceModel:
    return pem(inputs, outputs, ssarx(inputs, outputs, sample_time, order))


_METHODS: dict[str, Callable[[Arrays, Arrays, float, int], StateSpaceModel]] = {
    "ours": _ours,
    "ours_ssarx": ssarx,
    "ours_pbsid": pbsid,
}
NAMES = tuple(_METHODS)


def identify(name: str, inputs: Arrays, outputs: Arrays, sample_time: float, order: int) -> dict[str, Arrays]:
    """Matrices of the model, with the gain and covariance of its innovations."""
    model = _METHODS[name](inputs, outputs, sample_time, order)
    return {
        "a": model.a,
        "b": model.b,
        "c": model.c,
        "k": model.k,
        "innovation_covariance": model.innovation_covariance,
    }
