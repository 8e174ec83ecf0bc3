"""Progress and cancellation of long computations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_callable
from amb_core.linear.model.state_space import StateSpaceModel

PEM, FOCUSED = "pem", "simulation focus"
"""What models whose parameters a search found have as their method, or at its end."""


@dataclass(frozen=True)
class IdentificationProgress:
    """Progress of an identification.

    Attributes
    ----------
    stage : str
        `checks`, `order`, `subspace`, `pem`, `simulation focus`, `uncertainty` or `validation`.
    done, total : int
        Steps of the stage. An iteration may end before `total` is reached.
    cost : float, optional
        What an iteration reduces (-): for `pem`, half the logarithm of the determinant of the covariance of the
        prediction errors, scaled by the data's variances; None for a stage without iterations.
    """

    stage: str
    done: int
    total: int
    cost: float | None = None


@dataclass(frozen=True)
class SearchEnd:
    """How an iterative search ended.

    Attributes
    ----------
    iterations : int
        Steps tried, taken or not.
    left : float
        Relative decrease of the squared errors that a further step promises.
    converged : bool
        Whether that is so little that the search ended by itself, or a tenth at most of what the true parameters leave
        by chance.
    """

    iterations: int
    left: float
    converged: bool

    @classmethod
    def of(cls, model: StateSpaceModel) -> SearchEnd | None:
        """How the search of a model ended; None where there was none, or the model does not hold it."""
        if not model.search.size:
            return None
        iterations, left, converged = model.search
        return cls(int(iterations), float(left), bool(converged))

    @property
    def values(self) -> NDArray[np.float64]:
        """What a model holds of it, shape (3,)."""
        return np.array([self.iterations, self.left, self.converged], dtype=np.float64)


Progress = Callable[[IdentificationProgress], None]
Cancelled = Callable[[], bool]


class Watch:
    """Reports progress, and ends the computation once it is cancelled.

    Parameters
    ----------
    progress : callable, optional
        Called with every `IdentificationProgress`.
    cancelled : callable, optional
        Returns whether the computation has been cancelled.

    Attributes
    ----------
    search : SearchEnd or None
        How the search of the method ended; None if it has none.
    """

    def __init__(self, progress: Progress | None = None, cancelled: Cancelled | None = None) -> None:
        require_callable("progress", progress, IdentificationError)
        require_callable("cancelled", cancelled, IdentificationError)
        self._progress, self._cancelled = progress, cancelled
        self.search: SearchEnd | None = None

    def note_end(self, search: SearchEnd) -> None:
        """Keep how the search of the method ended."""
        self.search = search

    def tell(self, stage: str, done: int, total: int, cost: float | None = None) -> None:
        """Report the progress of a stage.

        Raises
        ------
        IdentificationError
            If the identification has been cancelled.
        """
        if self._cancelled is not None and self._cancelled():
            raise IdentificationError(f"identification cancelled in {stage}")
        if self._progress is not None:
            self._progress(IdentificationProgress(stage, done, total, cost))
