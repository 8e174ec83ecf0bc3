"""The model order that a signal determines, as `amb identify` decides it.

Identification accepts a model of n states if the recorded inputs, the control currents, are persistently exciting of a
sufficient order, and the samples suffice (`amb_core.data.experiments.checks`). So the same checks are made here, on the
control currents of a simulation. The number of lines in the reference is no substitute: without noise, currents of a
narrow band are so smooth at the sample rate that their lags are nearly collinear, however many lines they have.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, section 13.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks import Severity, check_amount, highest_excited_order

HIGHEST_ORDER = 20


@dataclass(frozen=True)
class ExcitedOrder:
    """Order of the models that a recording determines.

    Attributes
    ----------
    order : int
        Highest number of states of a model that identification accepts.
    tried : int
        Highest number of states that was tried; `order` may be higher if it equals this.
    """

    order: int
    tried: int

    def __str__(self) -> str:
        return f"up to {self.order}" + (", higher ones were not tried" if self.order >= self.tried else "")


def excited_order(
    current: NDArray[np.float64], position: NDArray[np.float64], sample_time: float, model_order: int | None = None
) -> ExcitedOrder:
    """Highest order that identification accepts of a recording of the excitation.

    Parameters
    ----------
    current, position : ndarray, shape (steps, axes)
        Control currents (A) and positions (m) of the excited part.
    sample_time : float
        Sample time (s).
    model_order : int, optional
        An order that is to be tried too. None for no such order.

    Returns
    -------
    ExcitedOrder
        The order, and the highest one that was tried.
    """
    tried = max(HIGHEST_ORDER, model_order or 0)
    data = IdentificationData.from_arrays(current, position, sample_time)
    return ExcitedOrder(determined_order(data, tried), tried)


def determined_order(data: IdentificationData, highest: int) -> int:
    """Highest order, up to a given one, for which data are persistently exciting and have samples enough.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    highest : int
        Highest number of states of interest.

    Returns
    -------
    int
        Number of states; 0 if the data determine no model.
    """
    order = highest_excited_order(data, highest)
    while order and check_amount(data, order).severity is Severity.ERROR:
        order -= 1
    return order
