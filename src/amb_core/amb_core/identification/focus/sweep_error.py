"""How well a model follows the response to a sweep: its error in bands of the input frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.loop.records import LoopRecord


@dataclass(frozen=True)
class SweepError:
    """Errors of a simulated position in n bands of the input frequency.

    Attributes
    ----------
    edges : ndarray, shape (n + 1,)
        Ends of the bands (Hz), rising.
    mean : ndarray, shape (n, axes)
        Mean of measured minus modelled position in each band, of each axis (m): the bias error of the model.
    movement : ndarray, shape (n, axes)
        Standard deviation of the error (m): the error of the movement.
    relative : ndarray, shape (n, axes)
        Root mean square of the error over the standard deviation of the measured position.
    """

    edges: NDArray[np.float64]
    mean: NDArray[np.float64]
    movement: NDArray[np.float64]
    relative: NDArray[np.float64]

    @property
    def middles(self) -> NDArray[np.float64]:
        """Geometric mean of the ends of each band (Hz), shape (n,)."""
        return np.sqrt(self.edges[:-1] * self.edges[1:])


def sweep_error(
    measured: LoopRecord, modelled: LoopRecord, frequency: NDArray[np.float64], bands: int = 16
) -> SweepError:
    """Errors of a simulation of a sweep, in bands that are equally wide on a logarithmic axis.

    Parameters
    ----------
    measured, modelled : LoopRecord
        The same steps of the plant and of a model under the same reference.
    frequency : ndarray, shape (steps,)
        Frequency of the input at each sample (Hz), positive.
    bands : int, optional
        Number of bands, at least 1.

    Raises
    ------
    IdentificationError
        If the records or the frequency do not fit together, or a band has fewer than two samples.
    """
    if not (measured.steps == modelled.steps == len(frequency)):
        raise IdentificationError(
            f"measured, modelled and frequency must have as many samples, not {measured.steps}, {modelled.steps} and "
            f"{len(frequency)}"
        )
    if not (np.all(np.isfinite(frequency)) and np.all(frequency > 0.0)):
        raise IdentificationError("the frequency of a sweep must be positive and finite at each sample")
    edges = np.geomspace(frequency.min(), frequency.max(), bands + 1)
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, bands - 1)
    error = measured.position - modelled.position
    mean, movement, relative = (np.empty((bands, error.shape[1])) for _ in range(3))
    for number in range(bands):
        chosen = band == number
        if np.count_nonzero(chosen) < 2:
            raise IdentificationError(
                f"band {edges[number]:.4g} Hz to {edges[number + 1]:.4g} Hz has fewer than two samples; use fewer bands"
            )
        mean[number] = error[chosen].mean(axis=0)
        movement[number] = error[chosen].std(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            relative[number] = np.sqrt((error[chosen] ** 2).mean(axis=0)) / measured.position[chosen].std(axis=0)
    return SweepError(edges, mean, movement, relative)
