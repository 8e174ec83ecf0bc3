"""Balanced reduction of an identified model, which may be unstable.

The model is split into its unstable part, which is kept as it is, and its stable part, which is balanced and truncated.

Sources: B. C. Moore, Principal component analysis in linear systems, IEEE Trans. Autom. Control 26 (1981); C. S. Hsu
and D. Hou, Reducing unstable linear control systems via real Schur transformation, Electronics Letters 27 (1991); for
the bound U. M. Al-Saggaf and G. F. Franklin, An error bound for a discrete reduced order model of a linear
multivariable system, IEEE Trans. Autom. Control 32 (1987).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import ctrlsys
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind, whole_number
from amb_core.identification.estimate.predictor import filter_gain
from amb_core.linear.model.state_space import StateSpaceModel

_BOUNDARY = 1.0 - 1e-9  # from this magnitude onwards a pole belongs to the unstable part, as integrators do


@dataclass(frozen=True)
class Reduction:
    """A model of lower order and what it lost.

    Attributes
    ----------
    model : StateSpaceModel
        The reduced model; `fit` is empty, and its innovation covariance is the one of the full model: validate it.
    hankel_singular_values : ndarray, shape (states,)
        Those of the stable part of the full model, largest first (m/A); the first of them are kept.
    unstable_states : int
        Number of states of the unstable part, all of which are kept.
    error_bound : float
        Upper bound of the largest singular value of the difference of the two frequency responses (m/A): twice the sum
        of the Hankel singular values left out.
    """

    model: StateSpaceModel
    hankel_singular_values: NDArray[np.float64]
    unstable_states: int
    error_bound: float


def reduce_balanced(model: StateSpaceModel, order: int) -> Reduction:
    """Reduce a model to an order by balanced truncation of the stable part of its deterministic part.

    Kalman gain and initial state are transformed into the remaining coordinates. If the predictor is then unstable, the
    gain is that of the Kalman filter for the same noise. A model without noise, as a file of A, B, C and D gives one,
    remains without a stable predictor: its K is zero, or its innovation covariance not positive definite.

    Parameters
    ----------
    model : StateSpaceModel
        The model.
    order : int
        Number of states of the reduced model.

    Returns
    -------
    Reduction
        The model of that order, and what it lost.

    Raises
    ------
    IdentificationError
        If the order is below 1 or the number of unstable poles, or above that of the states that matter.
    """
    require_kind("model", model, StateSpaceModel, "a StateSpaceModel", IdentificationError)
    order = whole_number("order", order, IdentificationError)
    unstable, into, out_of, values = _balanced(model)
    least, most = max(1, unstable), len(into)
    if not least <= order <= most:
        raise IdentificationError(
            f"order {order} is not allowed; allowed: {least} to {most}, since the model has {unstable} poles "
            f"that are not stable and {most - unstable} stable states that matter"
        )
    into, out_of = into[:order], out_of[:, :order]
    a, c, k = into @ model.a @ out_of, model.c @ out_of, into @ model.k
    if _has_noise(model) and np.max(np.abs(np.linalg.eigvals(a - k @ c))) >= 1.0:
        k = filter_gain(a, c, k, model.innovation_covariance)
    reduced = replace(
        model,
        a=a,
        b=into @ model.b,
        c=c,
        k=k,
        initial_state=into @ model.initial_state,
        method=f"{model.method}, reduced from order {model.order}",
        fit=np.empty(0),
        search=np.empty(0),
        undecided=(),
    )
    return Reduction(reduced, values, unstable, 2.0 * float(values[order - unstable :].sum()))


def _has_noise(model: StateSpaceModel) -> bool:
    """Whether the model describes noise, from which a Kalman gain follows."""
    try:
        np.linalg.cholesky(model.innovation_covariance)
    except np.linalg.LinAlgError:
        return False
    return bool(np.any(model.k))


def _balanced(
    model: StateSpaceModel,
) -> tuple[int, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Number of unstable states, transformation into them and the balanced stable states, out of them, singular values.

    The transformations have shapes (q, n), (n, q), for the q states that are unstable or matter.
    """
    schur, basis, unstable = linalg.schur(
        model.a, output="real", sort=lambda real, imaginary=0.0: np.hypot(real, imaginary) >= _BOUNDARY
    )
    into, out_of = basis.T.copy(), basis.copy()
    stable = model.order - unstable
    if unstable and stable:  # old versions of SciPy solve no empty equation
        coupling = linalg.solve_sylvester(
            schur[:unstable, :unstable], -schur[unstable:, unstable:], -schur[:unstable, unstable:]
        )
        into[:unstable] -= coupling @ basis.T[unstable:]
        out_of[:, unstable:] += basis[:, :unstable] @ coupling
    if not stable:
        return unstable, into, out_of, np.empty(0)
    a, b, c = schur[unstable:, unstable:], into[unstable:] @ model.b, model.c @ out_of[:, unstable:]
    # SLICOT computes the factors of the Gramians without the Gramians, so small singular values are accurate too.
    *_, values, out_of_balanced, into_balanced, kept, _, info = ctrlsys.ab09ax(
        "D", "B", "F", stable, b.shape[1], c.shape[0], stable, *map(np.asfortranarray, (a, b, c)), 0.0
    )
    if info != 0:
        raise IdentificationError(f"the stable part of the model cannot be balanced (SLICOT AB09AX, info {info})")
    return (
        unstable,
        np.vstack([into[:unstable], into_balanced[:kept] @ into[unstable:]]),
        np.hstack([out_of[:, :unstable], out_of[:, unstable:] @ out_of_balanced[:, :kept]]),
        values,
    )
