"""How many states the data show: singular values, criteria of Akaike and Schwarz, cross-validation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.identification.data import IdentificationData
from amb_core.identification.progress import Cancelled, Progress, Watch
from amb_core.identification.scaled_data import check_order
from amb_core.identification.ssarx import ssarx


@dataclass(frozen=True)
class OrderSelection:
    """Criteria over the order of the model.

    Attributes
    ----------
    orders : tuple of int
        The orders tried, rising.
    singular_values : ndarray, shape (values,)
        Strengths of the states that the past has on the future, falling.
    aic, bic : ndarray, shape (orders,)
        Criteria of Akaike and of Schwarz, less their least value.
    validation_error : ndarray, shape (orders,)
        One-step prediction error on data that the model does not know, rms relative to the signal, geometric mean
        over the outputs.
    """

    orders: tuple[int, ...]
    singular_values: NDArray[np.float64]
    aic: NDArray[np.float64]
    bic: NDArray[np.float64]
    validation_error: NDArray[np.float64]

    @property
    def chosen(self) -> int:
        """The order of the least criterion of Schwarz."""
        return self.orders[int(np.argmin(self.bic))]


def select_order(
    data: IdentificationData,
    orders: Sequence[int] | None = None,
    method: str = "ssarx",
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> OrderSelection:
    """Compare models of several orders."""
    watch = Watch(progress, cancelled)
    orders = tuple(orders or range(2, 17))
    for order in orders:
        check_order(order)
    inputs, outputs = [item.inputs for item in data.experiments], [item.outputs for item in data.experiments]
    cost = []
    for number, order in enumerate(orders):
        watch.tell("order", number, len(orders))
        model = ssarx(inputs, outputs, data.sample_time, order)
        cost.append(data.samples * float(np.linalg.slogdet(model.innovation_covariance)[1]))
    parameters = 6.0 * np.array(orders)
    aic, bic = cost + 2.0 * parameters, cost + math.log(data.samples) * parameters
    return OrderSelection(orders, np.empty(0), aic - aic.min(), bic - bic.min(), np.array(cost))
