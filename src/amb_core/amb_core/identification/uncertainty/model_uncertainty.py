"""Deviations of the poles and the frequency response, and nearby models, from the covariance of the parameters.

All results are by linearisation about the model (Gauss' approximation formula). Derivatives: with R = (z I - A)^-1,

    dG(z) = dC R B + C R dA R B + C R dB + dD,    d pole = w' dA v / (w' v)

for the pole's left and right eigenvectors w and v.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 9.5 and (9.56) to (9.59).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.identification.frequency_response import LEVEL, FrequencyResponse, normal_quantile, response_of, transfers
from amb_core.identification.uncertainty.directions import Directions, response_changes
from amb_core.identification.uncertainty.poles import PoleGroup, pole_groups
from amb_core.identification.uncertainty.samples import Sampler
from amb_core.linear.model.state_space import StateSpaceModel

_INFLATED = 1.25  # from this inflation onwards innovations are not white; even few data scatter less
_NOTABLE = 2.0  # difference to a richer model, over the random deviation, that chance hardly makes
_FAR = 2.0  # from this distance onwards the model is not the estimate; the true system is at 1


@dataclass(frozen=True, eq=False)
class ModelUncertainty:
    """The distribution of a model's parameters given its data: normal, about the model.

    The parameters are the entries of A, B, C and K, row by row, in the model's units and state coordinates. The n^2
    directions that only change the coordinates of the state are left out, so their covariance is singular, of rank
    n (2 p + m). With direct feedthrough the m p entries of D come after those of K. Quantities that do not depend on
    the coordinates, such as poles and responses, have the true deviation.

    Attributes
    ----------
    model : StateSpaceModel
        The model.
    root : ndarray, shape (n (n + m + 2 p), n (2 p + m)), each m p more with direct feedthrough, one column more with a
        `reference` Root of the covariance: each column is a change of the parameters, and with independent standard
        normal factors their sum is the difference between estimate and truth. Rows have the units of the parameters.
    inflation : float
        Mean ratio of the variances that the innovations of the data show to those that white innovations would give
        (-). Near 1 (within about 0.05) if the model explains the data; larger, rarely smaller, if the order is too low
        or the plant is not linear.
    distance : float
        Distance of the model from the one with the smallest prediction errors on the data (-): root mean square over
        all directions, relative to that of the deviations that the innovations show. Near 0 for the result of `pem` on
        these data, near 1 for the true system. If it is larger, the deviations are those of another model.
    robust : bool
        Whether the covariance uses the measured correlation of the innovations; otherwise it takes them as white.
    reference : ModelUncertainty or None
        Of a richer model from the same data, whose difference to this one is the last column of the root and counts in
        responses as an error; None where there is none, and for random errors alone.
    difference : float
        Its size, relative to the random deviation of the response (median over frequencies) (-).
    """

    model: StateSpaceModel
    root: NDArray[np.float64]
    inflation: float
    distance: float
    robust: bool
    reference: ModelUncertainty | None = None
    difference: float = 0.0

    @property
    def white(self) -> bool:
        """Whether `inflation` is consistent with white innovations of the data."""
        return 1.0 / _INFLATED < self.inflation < _INFLATED

    @property
    def summary(self) -> str:
        """One line of text: the unstable poles with their 99 % intervals, and whether they are reliable."""
        intervals = [_interval(group) for group in self.unstable_poles]
        text = f"unstable poles z = {', '.join(intervals)} at 99 %" if intervals else "no unstable poles"
        if not self.white:
            taken = "are taken" if self.robust else "should be taken (robust)"
            text += f"; innovations are not white and {taken} as they are: {self.inflation:.3g} times the variance"
        for remark in (self.widened, self.at_one):
            text += f"; {remark}" if remark else ""
        if self.distance > _FAR:
            text += f"; not the model that predicts these data best, but {self.distance:.2g} standard deviations away"
        return text

    @property
    def widened(self) -> str:
        """A remark on bands that are wider than random errors make them; empty where chance explains the difference."""
        if self.reference is None or self.difference <= _NOTABLE:
            return ""
        return (
            f"bands are widened: a model of order {self.reference.model.order} from the same data differs by "
            f"{self.difference:.2g} times the random deviation, so order {self.model.order} is too low for the plant "
            "or the colour of the noise"
        )

    @property
    def poles_at_one(self) -> NDArray[np.complex128]:
        """Poles whose 99 % region holds z = 1, shape (poles,): the data do not decide whether they are stable."""
        near = [group for group in self.pole_groups() if group.holds(1.0, LEVEL)]
        return np.concatenate([np.zeros(0, dtype=np.complex128), *(group.poles for group in near)])

    @property
    def at_one(self) -> str:
        """A remark on `poles_at_one`; empty if there are none."""
        poles = ", ".join(_number(pole) for pole in self.poles_at_one)
        if not poles:
            return ""
        return (
            f"the 99 % interval of pole z = {poles} holds 1: the data do not decide whether it is stable; slow drift "
            "causes such poles, as does too high an order"
        )

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the parameters, shape (r, r) for r rows of `root`; products of the units of the entries."""
        return self.root @ self.root.T

    @property
    def deviations(self) -> Directions:
        """The columns of the root as changes of A, B, C, K and, with direct feedthrough, D."""
        matrices = [self.model.a, self.model.b, self.model.c, self.model.k]
        if len(self.root) > sum(matrix.size for matrix in matrices):
            matrices.append(self.model.d)
        rows = np.split(self.root, np.cumsum([matrix.size for matrix in matrices])[:-1])
        return Directions(*(row.T.reshape(-1, *matrix.shape) for row, matrix in zip(rows, matrices, strict=True)))

    @property
    def pole_covariance(self) -> NDArray[np.float64]:
        """Covariance of real and imaginary part of each of `model.poles()`, z plane, shape (n, 2, 2).

        Poles of a complex pair have the same covariance except for the sign. For poles closer together than their
        deviations it means little, as a multiple pole has no derivative: see `pole_groups`.
        """
        by_direction = self._pole_changes()
        parts = np.stack([by_direction.real, by_direction.imag], axis=1)
        return np.asarray(parts @ parts.transpose(0, 2, 1))

    def pole_deviations(self) -> NDArray[np.float64]:
        """Standard deviation of real and imaginary part of each of `model.poles()`, z plane, shape (n, 2).

        Returns
        -------
        ndarray, shape (n, 2)
            Standard deviations in the z plane (-).
        """
        return np.sqrt(np.diagonal(self.pole_covariance, axis1=1, axis2=2))

    def pole_groups(self) -> list[PoleGroup]:
        """The poles, those together that are too close for `pole_covariance`; largest magnitude first.

        Returns
        -------
        list of PoleGroup
            Groups of poles with their covariance.

        Raises
        ------
        IdentificationError
            If the poles cannot be separated.
        """
        try:
            return pole_groups(self.model.a, self.deviations.a)
        except np.linalg.LinAlgError as problem:
            raise IdentificationError(f"the poles of the model cannot be separated: {problem}") from None

    @property
    def unstable_poles(self) -> list[PoleGroup]:
        """The groups with a pole outside the unit circle; of two complex conjugate ones that in the upper half."""
        return [
            group
            for group in self.pole_groups()
            if np.abs(group.poles).max() > 1.0 and (group.real or group.poles.imag.sum() > 0.0)
        ]

    def response(self, frequencies: ArrayLike, label: str = "") -> FrequencyResponse:
        """The model's frequency response with standard deviations.

        Near a zero of an entry, where the deviation is close to the magnitude, phase and logarithm of the magnitude are
        no longer linear in the parameters, and bands are only approximate. An entry that is 0 but for rounding has no
        direction: its magnitude has the deviation of its real and imaginary part on average, its phase that of pi.

        Parameters
        ----------
        frequencies : array_like, shape (f,)
            Frequencies (Hz), ascending, from 0 to half the sample rate.
        label : str, optional
            For legends; by default the method and the order.

        Returns
        -------
        FrequencyResponse
            The response with the standard deviations of magnitude and phase.

        Raises
        ------
        IdentificationError
            If a frequency is not allowed, or the model has a pole at it.
        """
        response = response_of(self.model, frequencies, label)
        magnitude, phase = np.empty(response.response.shape), np.empty(response.response.shape)
        deviations = self.deviations
        of_matrices = (deviations.a, deviations.b, deviations.c, deviations.d)
        for part, by_state, by_input in transfers(self.model, response.frequency, self.model.b):
            change = response_changes(by_state, by_input, *of_matrices)
            values = response.response[part]
            directed = np.abs(values) > rounding_of(values)
            size = np.where(directed, np.abs(values), 1.0)
            # Real part: along the response; imaginary: across.
            turned = change * (values.conj() / size)[..., np.newaxis]
            either_way = np.linalg.norm(change, axis=-1) / np.sqrt(2.0)
            magnitude[part] = np.where(directed, np.linalg.norm(turned.real, axis=-1), either_way)
            phase[part] = np.linalg.norm(turned.imag, axis=-1) / size
            if self.reference is not None:
                more = self._unexplained(self.reference, response.frequency[part], values, change)
                magnitude[part], phase[part] = np.hypot(magnitude[part], more), np.hypot(phase[part], more / size)
            phase[part][~directed] = np.pi
        return replace(response, magnitude_deviation=magnitude, phase_deviation=phase)

    def _unexplained(
        self,
        reference: ModelUncertainty,
        frequency: NDArray[np.float64],
        response: NDArray[np.complex128],
        change: NDArray[np.complex128],
    ) -> NDArray[np.float64]:
        """What a richer model says beyond the columns of the root: the rest of the difference, and its variance."""
        other = reference.response(frequency)
        assert other.magnitude_deviation is not None
        rest = np.abs(other.response - response - change[..., -1])
        random = np.linalg.norm(change[..., :-1], axis=-1) / np.sqrt(2.0)  # along the response, on average
        return np.hypot(rest / np.sqrt(2.0), np.sqrt(np.maximum(other.magnitude_deviation**2 - random**2, 0.0)))

    def samples(self, count: int, seed: int = 0) -> list[StateSpaceModel]:
        """Models drawn from the distribution, all with stable predictors, `fit` empty.

        A and C are drawn, B and K are those that give the responses their distribution: see
        `amb_core.identification.uncertainty.samples`. The few draws with an unstable predictor are repeated, so the
        distribution is truncated there. Innovation covariance and initial state are those of the model.

        Parameters
        ----------
        count : int
            Number of models.
        seed : int, optional
            Of the random numbers; the same seed gives the same models.

        Returns
        -------
        list of StateSpaceModel
            As many models as `count`.

        Raises
        ------
        IdentificationError
            If nearly no nearby model has a stable predictor.
        """
        random = np.random.default_rng(seed)
        return [self._sampler.draw(random) for _ in range(count)]

    def moved(self, factors: NDArray[np.float64]) -> StateSpaceModel:
        """The model at a place of the distribution, as `samples` forms it.

        Parameters
        ----------
        factors : ndarray, shape (q,)
            Standard deviations along each column of the root (-).

        Returns
        -------
        StateSpaceModel
            The model there, `fit` empty.
        """
        return self._sampler.moved(np.asarray(factors, dtype=np.float64))

    @cached_property
    def _sampler(self) -> Sampler:
        return Sampler.of(self.model, self.deviations)

    def _pole_changes(self) -> NDArray[np.complex128]:
        """Change of each pole, in the order of `model.poles()`, by each column of the root, shape (n, q)."""
        values, right = np.linalg.eig(self.model.a)
        order = np.argsort(-np.abs(values), kind="stable")
        try:
            left = np.linalg.inv(right)
        except np.linalg.LinAlgError:
            raise IdentificationError("the model has a multiple pole, which has no standard deviation") from None
        return np.asarray(np.einsum("in,qnm,mi->iq", left, self.deviations.a, right, optimize=True)[order])


def rounding_of(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """What rounding makes of a zero entry of a response of shape (f, p, m), from its largest one: shape (f, 1, 1)."""
    return np.asarray(np.finfo(float).eps * np.abs(response).max(axis=(1, 2), keepdims=True, initial=0.0))


def _interval(group: PoleGroup) -> str:
    """Poles of a group with their 99 % interval: of each pole, or of the magnitude of close ones."""
    reach = normal_quantile(LEVEL)
    if len(group.poles) == 1:
        return f"{_number(complex(group.poles[0]))} ± {reach * float(np.linalg.norm(group.changes)):.1g}"
    low, high = group.magnitudes(reach)
    poles = ", ".join(_number(complex(pole)) for pole in group.poles)
    return f"{poles} (close poles, magnitudes {low:.6f} to {high:.6f})"


def _number(pole: complex) -> str:
    return f"{pole.real:.6f}" if pole.imag == 0.0 else f"{pole:.6f}"
