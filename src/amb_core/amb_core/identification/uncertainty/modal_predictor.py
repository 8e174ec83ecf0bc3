"""A model's predictor in modal coordinates: its parameters, and the derivatives of the predictions by all of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.filter_bank import (
    Modes,
    compressed,
    gain_sensitivity,
    modal_basis,
    mode_sensitivity,
)
from amb_core.identification.local_coordinates import local_directions
from amb_core.identification.model import StateSpaceModel
from amb_core.identification.predictor import innovations
from amb_core.identification.scaled_data import ScaledData

_LEAST_SQUARE = 1e-24  # of a Hankel singular value, relative to the largest

Arrays = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModalPredictor:
    """The predictor of a model, in modal coordinates and for scaled data.

    Its parameters are the gains (block, state, channel), the entries of `modes.m` and those of `modes.c`.

    Attributes
    ----------
    modes : Modes
        F = A - K C and C.
    gains : ndarray, shape (blocks, 2, m + p + experiments)
        B, K and every x[0], which is the one of least prediction errors.
    basis : ndarray, shape (n, n)
        From these coordinates into those of the model.
    weight : ndarray, shape (p, p)
        Weighted errors have the unit matrix as covariance.
    measured : int
        Channels that are signals, m + p.
    """

    modes: Modes
    gains: Arrays
    basis: Arrays
    weight: Arrays
    measured: int

    @classmethod
    def of(cls, model: StateSpaceModel, data: ScaledData) -> ModalPredictor:
        """The predictor of a model that is given in original units.

        Raises
        ------
        LinAlgError
            If pairs of its modes are not independent, or the innovation covariance is not positive definite.
        """
        f, c = model.a - model.k @ model.c, model.c / data.output_scale[:, np.newaxis]
        modes, basis = Modes.of(f, c), modal_basis(f, c)
        weight = np.linalg.inv(np.linalg.cholesky(model.innovation_covariance)) * data.output_scale
        given = np.linalg.solve(basis, np.hstack([model.b * data.input_scale, model.k * data.output_scale]))
        given = np.pad(given, ((0, modes.m.shape[0] * 2 - model.order), (0, 0))).reshape(len(modes.m), 2, -1)
        signals, targets = compressed(modes, data.inputs, data.outputs, weight, data.lengths)
        by_gain = gain_sensitivity(modes, signals, weight).reshape(len(targets), *given.shape[:2], -1)
        by_given, by_state = np.split(by_gain, [given.shape[2]], axis=3)
        rest = targets - np.tensordot(by_given, given, axes=3)
        states = linalg.lstsq(by_state.reshape(len(rest), -1), rest, check_finite=False)[0]
        return cls(modes, np.dstack([given, states.reshape(*given.shape[:2], -1)]), basis, weight, given.shape[2])

    @cached_property
    def directions(self) -> Arrays:
        """Orthonormal directions in which B, K, F and C change the model and not only its coordinates.

        Shape (parameters, n (2 p + m)). Initial states are left out.
        """
        of_gains, of_m, of_c = self._places
        found = []
        for block, (m, gains, c) in enumerate(zip(self.modes.m, self.gains, self.modes.c, strict=True)):
            size = min(2, self.modes.order - 2 * block)  # without padding
            changes = local_directions(m[:size, :size], gains[:size, : self.measured], c[:, :size])
            places = (of_m[block, :size, :size], of_gains[block, :size, : self.measured], of_c[block, :, :size])
            columns = np.zeros((self.parameters, changes[0].shape[-1]))
            for place, change in zip(places, changes, strict=True):
                columns[place.ravel()] = change.reshape(place.size, -1)
            found.append(columns)
        return np.hstack(found)

    @property
    def initial_states(self) -> NDArray[np.int64]:
        """Which of the parameters are initial states."""
        return self._places[0][:, :, self.measured :].ravel()

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return self.gains.size + self.modes.m.size + self.modes.c.size

    def sensitivity(self, signals: Arrays) -> Arrays:
        """Derivatives of the weighted predictions by the parameters, shape (p, rows, parameters).

        `signals` are those of the filter bank, shape (rows, blocks, 4, channels).
        """
        by_gain = gain_sensitivity(self.modes, signals, self.weight)
        by_mode = mode_sensitivity(self.modes, self.gains, signals, self.weight)
        return np.hstack([by_gain, by_mode]).reshape(len(self.weight), len(signals), -1)

    def errors(self, data: ScaledData) -> Arrays:
        """Weighted one-step prediction errors, shape (steps, p)."""
        f, c = self.modes.matrices()
        gains = np.vstack(list(self.gains))[: self.modes.order]
        b, k, states = np.split(gains, [data.inputs.shape[1], self.measured], axis=1)
        return innovations(f + k @ c, b, c, k, states.T, data.inputs, data.outputs, data.lengths) @ self.weight.T

    def changes_of(self, model: StateSpaceModel, data: ScaledData, signals: Arrays, changes: Arrays) -> Arrays:
        """Changes of the parameters, shape (parameters, q), as changes of a model's A, B, C and K in its coordinates.

        Shape (n (n + m + 2 p), q): the entries row by row. Modes that are close to one another stay uncoupled only at
        the price of large changes, most of which just change coordinates. So these are taken out: what is left is the
        smallest change of A, B and C, in balanced coordinates, that has the same effect. Models are thus linear in the
        parameters as far as can be.

        Parameters
        ----------
        model, data : StateSpaceModel, ScaledData
            Those of `of`.
        signals : ndarray, shape (rows, blocks, 4, channels)
            Factor of the filter bank's signals.
        changes : ndarray, shape (parameters, q)
            The changes.
        """
        m, q = data.inputs.shape[1], changes.shape[1]
        f, gains, c = self._matrices(changes)
        basis = self._balanced(signals)
        back, into_model = np.linalg.inv(basis), self.basis @ basis
        from_model = np.linalg.inv(into_model)
        own = np.asarray(from_model @ np.hstack([model.b * data.input_scale, model.k * data.output_scale]))
        own_c = model.c / data.output_scale[:, np.newaxis] @ into_model
        gains, c = back @ gains, c @ basis
        a = back @ f @ basis + gains[:, :, m:] @ own_c + own[:, m:] @ c
        own_a = from_model @ model.a @ into_model
        transformation = _change_of_coordinates(own_a, own[:, :m], own_c, a, gains[:, :, :m], c)
        a = a - transformation @ own_a + own_a @ transformation
        gains, c = gains - transformation @ own, c + own_c @ transformation
        b, k = np.split(into_model @ gains, [m], axis=2)
        changed = (
            into_model @ a @ from_model,
            b / data.input_scale,
            c @ from_model * data.output_scale[:, np.newaxis],
            k / data.output_scale,
        )
        return np.hstack([change.reshape(q, -1) for change in changed]).T

    def _matrices(self, changes: Arrays) -> tuple[Arrays, Arrays, Arrays]:
        """Changes of the parameters as changes of F, (B, K) and C, shapes (q, n, n), (q, n, m + p), (q, p, n)."""
        n, q = self.modes.order, changes.shape[1]
        of_gains, of_m, of_c = self._places
        f = np.zeros((q, 2 * len(of_m), 2 * len(of_m)))
        for block, places in enumerate(of_m):
            f[:, 2 * block : 2 * block + 2, 2 * block : 2 * block + 2] = changes[places].transpose(2, 0, 1)
        gains = changes[of_gains[:, :, : self.measured]].transpose(3, 0, 1, 2).reshape(q, -1, self.measured)
        c = changes[of_c].transpose(3, 1, 0, 2).reshape(q, len(self.weight), -1)
        return f[:, :n, :n], gains[:, :n], c[:, :, :n]

    def _balanced(self, signals: Arrays) -> Arrays:
        """Columns are balanced coordinates, in which each state is seen in the predictions as much as the data move it.

        Shape (n, n), from them into modal coordinates.
        """
        n, adjoint_gains = self.modes.order, self.modes.adjoint @ self.gains
        states = np.einsum("bac,rbc->rba", self.gains, signals[:, :, 1])
        states -= np.einsum("bac,rbc->rba", adjoint_gains, signals[:, :, 0])
        moved = np.asarray(np.linalg.qr(states.reshape(len(states), -1)[:, :n], mode="r")).T
        f, c = self.modes.matrices()
        seen = linalg.solve_discrete_lyapunov(f.T, c.T @ c)
        vectors, squares, _ = np.linalg.svd(moved.T @ seen @ moved)
        return np.asarray(moved @ vectors / np.maximum(squares, _LEAST_SQUARE * squares[0]) ** 0.25)

    @cached_property
    def _places(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Where the gains, `modes.m` and `modes.c` are among the parameters, in their shapes."""
        places = np.split(np.arange(self.parameters), np.cumsum([self.gains.size, self.modes.m.size]))
        return (
            places[0].reshape(self.gains.shape),
            places[1].reshape(self.modes.m.shape),
            places[2].reshape(self.modes.c.shape),
        )


def _change_of_coordinates(a: Arrays, b: Arrays, c: Arrays, by_a: Arrays, by_b: Arrays, by_c: Arrays) -> Arrays:
    """X for which changes of A, B and C less X A - A X, X B and -C X are smallest, shape (q, n, n)."""
    n, unit = len(a), np.eye(len(a))
    # Entry (row, column) of X along the last axis.
    of_a = np.einsum("ir,cj->ijrc", unit, a) - np.einsum("ir,cj->ijrc", a, unit)
    of_b, of_c = np.einsum("ir,cj->ijrc", unit, b), -np.einsum("ir,cj->ijrc", c, unit)
    effects = np.vstack([effect.reshape(-1, n * n) for effect in (of_a, of_b, of_c)])
    changes = np.hstack([change.reshape(len(change), -1) for change in (by_a, by_b, by_c)]).T
    found = linalg.lstsq(effects, changes, lapack_driver="gelsy", check_finite=False)[0]
    return np.asarray(found.T.reshape(-1, n, n))
