"""Data-driven local coordinates: the directions that change a state-space model and not only the basis of its states.

A model (A, B, C) with n states, m inputs and p outputs has n (n + m + p) matrix entries, but n^2 of their directions
are changes of the state's coordinates, T A T^-1, T B, C T^-1, to first order

    X A - A X,  X B,  -C X.

The n (m + p) directions orthogonal to these are coordinates of the nearby models.

Source: T. McKelvey, A. Helmersson and T. Ribarits, Data driven local coordinates for multivariable linear systems and
their application to system identification, Automatica 40 (2004).
"""

from __future__ import annotations

from dataclasses import replace

import ctrlsys
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.linear.model.state_space import StateSpaceModel

Arrays = NDArray[np.float64]


def local_directions(a: Arrays, b: Arrays, c: Arrays) -> tuple[Arrays, Arrays, Arrays]:
    """Orthonormal directions of change of A, B and C, shapes (n, n, q), (n, m, q), (p, n, q) with q = n (m + p).

    In innovations form K changes as B does, so b may be (B, K).
    """
    n, m, p = len(a), b.shape[1], len(c)
    unit = np.eye(n)
    # Entry (row, column) of X along the last axis.
    by_a = np.einsum("ir,cj->ijrc", unit, a) - np.einsum("ir,cj->ijrc", a, unit)
    by_b = np.einsum("ir,cj->ijrc", unit, b)
    by_c = -np.einsum("ir,cj->ijrc", c, unit)
    changes = np.vstack([change.reshape(-1, n * n) for change in (by_a, by_b, by_c)])
    others = np.linalg.qr(changes, mode="complete")[0][:, n * n :]
    of_a, of_b, of_c = np.split(others, [n * n, n * (n + m)])
    return of_a.reshape(n, n, -1), of_b.reshape(n, m, -1), of_c.reshape(p, n, -1)


def balanced_predictor(model: StateSpaceModel, input_scale: Arrays) -> StateSpaceModel:
    """The model in balanced coordinates: each state of its predictor is as controllable as it is observable.

    Small changes of the matrices then are small changes of the model. In other coordinates, such as those of nearly
    equal modes, they can be large. A model with states that are neither controllable nor observable is returned
    unchanged.

    Parameters
    ----------
    model : StateSpaceModel
        Model with a stable predictor.
    input_scale : ndarray, shape (m,)
        Standard deviations of the inputs (A). Those of the outputs are taken to be those of the innovations.

    Raises
    ------
    IdentificationError
        If the predictor is not stable.
    """
    schur, basis = linalg.schur(model.a - model.k @ model.c)
    radius = float(np.max(np.abs(linalg.eigvals(schur))))
    if not radius < 1.0:
        raise IdentificationError(f"the model must have a stable predictor; its spectral radius is {radius:.6g}")
    scale = np.sqrt(np.diag(model.innovation_covariance))
    b, c = basis.T @ np.hstack([model.b * input_scale, model.k * scale]), model.c @ basis / scale[:, np.newaxis]
    # SLICOT computes the factors of the Gramians without the Gramians, so small singular values are accurate too.
    *_, out_of, into, kept, _, info = ctrlsys.ab09ax(
        "D", "B", "F", model.order, b.shape[1], len(c), model.order, *map(np.asfortranarray, (schur, b, c)), 0.0
    )
    if info != 0 or kept < model.order:
        return model
    into, out_of = into @ basis.T, basis @ out_of
    return replace(
        model,
        a=into @ model.a @ out_of,
        b=into @ model.b,
        c=model.c @ out_of,
        k=into @ model.k,
        initial_state=into @ model.initial_state,
    )
