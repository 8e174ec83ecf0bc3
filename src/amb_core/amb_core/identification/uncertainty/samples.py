"""Models drawn from the distribution of an estimate.

Far from the estimate a model is not linear in its matrices: poles that the data determine badly, such as fast ones,
would spoil gains that they determine well. So only A and C are drawn, and D if there is direct feedthrough. B and K are
fitted: they bring the responses to inputs and innovations, C R B and C R K with R = (z I - A)^-1, closest to the
linearised responses of the draw, over frequencies and relative to their deviations. The prediction errors of the models
then grow like those of a normal distribution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.identification.frequency_response import transfers
from amb_core.identification.uncertainty.directions import Directions, response_changes
from amb_core.linear.model.state_space import StateSpaceModel

_FREQUENCIES = np.geomspace(1e-4, 1.0, 200)  # at which responses are compared, relative to half the sample rate
_SMALLEST = 1e-100  # deviation of a response, relative to the largest, that still has a weight
_MOST_DRAWS = 100  # of each model, until its predictor is stable
_LARGEST_RADIUS = 1.0 - 1e-9  # of its predictor


@dataclass(frozen=True, eq=False)
class Sampler:
    """The common data of all drawn models.

    Attributes
    ----------
    model : StateSpaceModel
        The estimate.
    deviations : Directions
        Independent changes of it, each by one standard deviation.
    response : ndarray of complex, shape (f, p, m + p)
        Its response to inputs and innovations, without D.
    changes : ndarray of complex, shape (f, p, m + p, q)
        Change of this by each of the deviations.
    """

    model: StateSpaceModel
    deviations: Directions
    response: NDArray[np.complex128]
    changes: NDArray[np.complex128]

    @classmethod
    def of(cls, model: StateSpaceModel, deviations: Directions) -> Sampler:
        """The sampler of an estimate."""
        gains, of_gains = np.hstack([model.b, model.k]), np.concatenate([deviations.b, deviations.k], axis=2)
        responses, changes = [], []
        for _, by_state, by_gain in transfers(model, _frequency(model), gains):
            responses.append(by_state @ gains)
            changes.append(response_changes(by_state, by_gain, deviations.a, of_gains, deviations.c))
        return cls(model, deviations, np.concatenate(responses), np.concatenate(changes))

    def draw(self, random: np.random.Generator) -> StateSpaceModel:
        """One model, with a stable predictor.

        Raises
        ------
        IdentificationError
            If nearly no nearby model has one.
        """
        for _ in range(_MOST_DRAWS):
            model = self.moved(random.normal(size=self.deviations.count))
            if np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))) < _LARGEST_RADIUS:
                return model
        raise IdentificationError(
            f"of {_MOST_DRAWS} models drawn none has a stable predictor: the data leave the model of order "
            f"{self.model.order} too uncertain; lower the order or take more data"
        )

    def moved(self, factors: NDArray[np.float64]) -> StateSpaceModel:
        """The model at some independent standard deviations from the estimate, shape (q,)."""
        moved = replace(
            self.model,
            a=self.model.a + np.tensordot(factors, self.deviations.a, axes=1),
            c=self.model.c + np.tensordot(factors, self.deviations.c, axes=1),
            fit=np.empty(0),
        )
        if self.deviations.d is not None:
            moved = replace(moved, d=moved.d + np.tensordot(factors, self.deviations.d, axes=1))
        by_state = np.concatenate([part for _, part, _ in transfers(moved, _frequency(moved), moved.b)])
        wanted = self.response + self.changes @ factors
        size = np.linalg.norm(self.changes, axis=-1)
        weight = 1.0 / np.maximum(size, _SMALLEST * size.max() or 1.0)
        gains = np.empty((moved.order, wanted.shape[2]))
        for channel in range(wanted.shape[2]):
            rows = (by_state * weight[:, :, channel, np.newaxis]).reshape(-1, moved.order)
            targets = (wanted[:, :, channel] * weight[:, :, channel]).ravel()
            rows, targets = np.vstack([rows.real, rows.imag]), np.concatenate([targets.real, targets.imag])
            scale = np.linalg.norm(rows, axis=0)
            gains[:, channel] = linalg.lstsq(rows / scale, targets, check_finite=False)[0] / scale
        b, k = np.split(gains, [moved.b.shape[1]], axis=1)
        return replace(moved, b=b, k=k)


def _frequency(model: StateSpaceModel) -> NDArray[np.float64]:
    return _FREQUENCIES * 0.5 / model.sample_time
