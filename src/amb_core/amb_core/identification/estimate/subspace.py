"""Classic subspace identification (N4SID, MOESP) of a plant that may be unstable.

SLICOT's IB01AD and IB01BD estimate the order-n state space and the noise covariances; the Kalman gain comes from
scipy's Riccati solver, because IB01BD's own (jobck 'K') writes outside its workspace from order 8 on. IB01BD always
returns a feedthrough D, which a bearing does not have (the position responds after the current reference), so B, x[0]
and, where wanted, D are estimated again by least squares on the one-step prediction error (see `predictor`).

Known limit: projections that assume inputs independent of past noise are biased on closed-loop data. The bias
falls with the ratio of noise to excitation; below 0.1 um of noise at 50 um of excitation it does not matter.

Sources: P. Van Overschee and B. De Moor, Subspace Identification for Linear Systems, Kluwer, 1996; V. Sima,
D. M. Sima and S. Van Huffel, High-performance numerical algorithms and software for subspace-based linear multivariable
system identification, J. Comput. Appl. Math. 170 (2004).
"""

from __future__ import annotations

from typing import Literal

import ctrlsys
import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.predictor import fit_input_matrix, kalman_gain
from amb_core.identification.estimate.scaled_data import ScaledData, check_order
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import small_matrices

HORIZONS = (1.2, 1.5, 2.0, 3.0, 5.0)  # block rows in multiples of the order
_SLICOT_NAMES = {"n4sid": ("N", "C"), "moesp": ("M", "M")}  # of compression and of system matrices
_MOST_BLOCK_ROWS = 200
_MOST_ELEMENTS = 30_000_000  # of the data matrix, which SLICOT allocates if it must change from Cholesky to QR: 240 MB
_LEAST_BLOCK_ROWS = 8


def n4sid(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    sample_time: float,
    order: int = 10,
    block_rows: int | None = None,
    source: str = "",
    method: Literal["n4sid", "moesp"] = "n4sid",
    feedthrough: bool = False,
) -> StateSpaceModel:
    """Identify a state-space model of a given order; means are removed from the data and kept as its offsets.

    Parameters
    ----------
    inputs, outputs : ndarray, shapes (steps, m), (steps, p)
        Inputs and outputs, in any units of their own.
    sample_time : float
        Sample time of the data (s).
    order : int, optional
        Number of states n.
    block_rows : int, optional
        Block rows of the Hankel matrices (past and future horizon), more than the order; twice the order by default.
    source : str, optional
        Where the data come from, kept in the model.
    method : str, optional
        Algorithm of SLICOT.
    feedthrough : bool, optional
        Whether outputs respond within the sample; D is then estimated, and zero otherwise.

    Returns
    -------
    StateSpaceModel
        The model in innovations form; `fit` is empty.

    Raises
    ------
    IdentificationError
        If the order does not suit the data or the data determine no model; one line with the reason.
    """
    if block_rows is None:
        block_rows = _horizon(order, 2.0)
    data = ScaledData.of(inputs, outputs)
    if len(data.lengths) > 1:
        raise IdentificationError(f"{method} takes one experiment; ssarx, pbsid, cva and pem take several")
    _check_size(order, block_rows, data)
    u, y = data.inputs, data.outputs
    with small_matrices(f"no model of order {order} from {len(inputs)} samples"):
        a, c, k = _predictor_matrices(u, y, order, block_rows, method)
        b, d, initial_states = fit_input_matrix(a, c, k, u, y, feedthrough=feedthrough)
        return data.model(a, b, c, k, initial_states, sample_time, method, source, d)


def n4sid_horizons(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    sample_time: float,
    order: int = 10,
    source: str = "",
    method: Literal["n4sid", "moesp"] = "n4sid",
    feedthrough: bool = False,
) -> list[StateSpaceModel]:
    """Models of one order from horizons of different length, at least one; arguments and errors are those of `n4sid`.

    A long horizon averages noise, a short one tolerates a drifting operating point. The data show which is better. For
    long data only short horizons are tested, to limit time and memory.
    """
    models: list[StateSpaceModel] = []
    reasons: list[IdentificationError] = []
    shortest, *longer = sorted({_horizon(order, ratio) for ratio in HORIZONS})
    data = ScaledData.of(inputs, outputs)
    size = 2 * (data.inputs.size + data.outputs.size)
    affordable = [block_rows for block_rows in longer if size * block_rows <= _MOST_ELEMENTS]
    for block_rows in [shortest, *affordable]:
        try:
            models.append(n4sid(inputs, outputs, sample_time, order, block_rows, source, method, feedthrough))
        except IdentificationError as reason:
            reasons.append(reason)
    if not models:
        raise reasons[0]
    return models


def samples_needed(block_rows: int, signals: int) -> int:
    """Fewest samples that SLICOT takes, for that many inputs and outputs together."""
    return 2 * (signals + 1) * block_rows - 1


def _horizon(order: int, ratio: float) -> int:
    return max(_LEAST_BLOCK_ROWS, round(ratio * order))


def _check_size(order: int, block_rows: int, data: ScaledData) -> None:
    check_order(order)
    samples, needed = len(data.inputs), samples_needed(block_rows, data.inputs.shape[1] + data.outputs.shape[1])
    if not order < block_rows <= _MOST_BLOCK_ROWS:
        raise IdentificationError(
            f"block_rows {block_rows} is not allowed; allowed: {order + 1} to {_MOST_BLOCK_ROWS} for order {order}"
        )
    if samples < needed:
        raise IdentificationError(f"{samples} samples are too few for order {order}; at least {needed} are needed")


def _predictor_matrices(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    order: int,
    block_rows: int,
    method: Literal["n4sid", "moesp"],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A, C and the Kalman gain K of scaled data."""
    m, p = inputs.shape[1], outputs.shape[1]
    u, y = np.asfortranarray(inputs), np.asfortranarray(outputs)
    compression, system = _SLICOT_NAMES[method]
    # Correlation matrix and Cholesky factor ('C'), 40 times faster than QR; if that fails, SLICOT uses QR itself.
    _, triangle, _, _, info = ctrlsys.ib01ad(compression, "C", "N", "O", "N", "N", block_rows, m, p, u, y, 0.0, 0.0)
    if info != 0:
        raise IdentificationError(f"the data matrix cannot be compressed (SLICOT IB01AD, info {info})")
    # A and C only: with job 'A', B and D too, ctrlsys gives SLICOT too small a workspace for long horizons.
    a, c, _, _, q, r, s, _, _, info = ctrlsys.ib01bd(system, "C", "C", block_rows, order, m, p, len(u), triangle, 0.0)
    if info != 0:
        raise IdentificationError(f"the system matrices cannot be estimated (SLICOT IB01BD, info {info})")
    return a, c, kalman_gain(a, c, q, r, s)
