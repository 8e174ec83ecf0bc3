"""How well a modelled signal reproduces a measured one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import numbers

BELOW_ZERO = "below 0 %"

BELOW_ZERO_MEANING = (
    "A fit below 0 % means an error larger than the motion: that of deviations alone is the offset between the means "
    "of model and record, that of a prediction many steps ahead the growth of an unstable plant."
)


def nrmse_fit(measured: NDArray[np.float64], modelled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalised root-mean-square error fit of each column, 100 (1 - ||y - yhat|| / ||y - mean(y)||) percent.

    100 is a perfect model, 0 one that is no better than the mean; it can be negative.

    Parameters
    ----------
    measured, modelled : ndarray, shape (steps, p)
        Signals, in one unit of any kind.

    Returns
    -------
    ndarray, shape (p,)
        Fit (percent).

    Raises
    ------
    IdentificationError
        If the shapes differ, a value is not finite or a measured column is constant, so that no fit is defined.
    """
    measured, modelled = (
        numbers(name, values, IdentificationError) for name, values in (("measured", measured), ("modelled", modelled))
    )
    if measured.shape != modelled.shape or measured.ndim != 2:
        raise IdentificationError(f"measured {measured.shape} and modelled {modelled.shape} must be (steps, p) alike")
    if not (np.all(np.isfinite(measured)) and np.all(np.isfinite(modelled))):
        raise IdentificationError("measured and modelled must be finite")
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    constant = np.flatnonzero(np.ptp(measured, axis=0) == 0.0)
    if constant.size:
        raise IdentificationError(f"output {constant[0] + 1} is constant, so no fit is defined for it")
    error = np.linalg.norm(measured - modelled, axis=0)
    return np.asarray(100.0 * (1.0 - error / spread))


def fit_text(fit: float, decimals: int = 2) -> str:
    """A fit in words that readers cannot misread.

    Parameters
    ----------
    fit : float
        Fit (percent).
    decimals : int, optional
        Decimals of the percentage.

    Returns
    -------
    str
        The percentage; of a negative fit `BELOW_ZERO`: how far below is no measure of quality, since it grows with the
        offset of the means over the motion.
    """
    return f"{fit:.{decimals}f} %" if fit >= 0.0 else BELOW_ZERO
