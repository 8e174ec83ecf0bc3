"""A plant whose currents arrive a fraction of a sample later than in the data of its model.

Whole samples are delays of the controller (`feedback_of`). Within a sample the held current changes at t_k + tau, as it
does where a computation takes part of the sample: with X = [[A, B], [0, I]] and f = 1 - tau/T,

    X^f = [[A^f, B_0], [0, I]],    x[k+1] = A x[k] + (B - B_0) u[k-1] + B_0 u[k].

This is `amb_core.linear.sampling.discretised` with a delay, from the samples themselves. It is exact for a plant that
lives in continuous time. A pole on the negative real axis, which alternates from sample to sample, is that of a pair of
modes at half the sample rate, of which the samples show one: the real part of the power is theirs. A pole at z = 0 is
dead time of whole samples, behind which the change of the current cannot be placed.

Sources: G. F. Franklin, J. D. Powell and M. L. Workman, Digital Control of Dynamic Systems, 3rd ed., 1998, section 4.3;
N. J. Higham, Functions of Matrices, SIAM, 2008, section 3.1 (derivative from the function of [[X, E], [0, X]]).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import linalg

from amb_core.ground.errors import RobustnessError
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.identification.uncertainty.directions import Directions
from amb_core.linear import Arrays
from amb_core.linear.model import StateSpaceModel

DEAD = 1e-9  # magnitude of a pole below which it is dead time


def late_model(model: StateSpaceModel, fraction: float) -> StateSpaceModel:
    """A model whose inputs take effect a fraction of a sample later; its further states are the inputs before.

    Raises
    ------
    RobustnessError
        If the model has a pole at z = 0.
    """
    if not fraction:
        return model
    if np.abs(model.poles()).min(initial=1.0) < DEAD:
        raise RobustnessError(
            "extra_delay with a fraction of a step is not possible for a model with a pole at z = 0, a dead time; "
            "remove it from the data (advance_inputs), or give a whole number of steps"
        )
    m = model.inputs
    b_0 = _held_part(_extended(model.a, model.b), fraction)[: model.order, -m:]
    return replace(
        model,
        a=_beside(model.a, model.b - b_0),
        b=np.vstack([b_0, np.eye(m)]),
        c=np.hstack([model.c, np.zeros((model.outputs, m))]),
        k=np.vstack([model.k, np.zeros((m, model.outputs))]),
        initial_state=np.concatenate([model.initial_state, np.zeros(m)]),
    )


def late_uncertainty(uncertainty: ModelUncertainty, fraction: float) -> ModelUncertainty:
    """The distribution of the late model; errors as for `late_model`."""
    if not fraction:
        return uncertainty
    model, changes = uncertainty.model, uncertainty.deviations
    late, (n, m) = late_model(model, fraction), model.b.shape
    x, size = _extended(model.a, model.b), n + m
    of_b_0 = np.empty_like(changes.b)
    for number, (of_a, of_b) in enumerate(zip(changes.a, changes.b, strict=True)):
        moved = np.zeros((size, size))
        moved[:n] = np.hstack([of_a, of_b])
        both = np.block([[x, moved], [np.zeros((size, size)), x]])
        of_b_0[number] = _held_part(both, fraction)[:n, size + n :]
    directions = Directions(
        np.array([_beside(*one) for one in zip(changes.a, changes.b - of_b_0, strict=True)]),
        np.concatenate([of_b_0, np.zeros((changes.count, m, m))], axis=1),
        np.concatenate([changes.c, np.zeros((changes.count, model.outputs, m))], axis=2),
        np.concatenate([changes.k, np.zeros((changes.count, m, model.outputs))], axis=1),
    )
    return replace(uncertainty, model=late, root=directions.rows.T)


def _extended(a: Arrays, b: Arrays) -> Arrays:
    """[[A, B], [0, I]]."""
    n, m = b.shape
    extended = np.eye(n + m)
    extended[:n] = np.hstack([a, b])
    return extended


def _held_part(matrix: Arrays, fraction: float) -> Arrays:
    """The power 1 - fraction of a matrix."""
    return np.asarray(linalg.expm((1.0 - fraction) * linalg.logm(matrix)).real)


def _beside(a: Arrays, from_held: Arrays) -> Arrays:
    """A with the effect of the held inputs, which the next sample replaces."""
    n, m = from_held.shape
    beside = np.zeros((n + m, n + m))
    beside[:n] = np.hstack([a, from_held])
    return beside
