"""How long computations tell how far they are, and how they are called off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from amb_core.errors import IdentificationError


@dataclass(frozen=True)
class IdentificationProgress:
    """How far an identification is.

    Attributes
    ----------
    stage : str
        `checks`, `order`, `subspace`, `pem`, `simulation focus`, `uncertainty` or `validation`.
    done, total : int
        Steps of the stage. An iteration may end before `total` is reached.
    cost : float, optional
        What an iteration lowers: of `pem`, half the logarithm of the determinant of the covariance of the prediction
        errors, scaled by the data's variances.
    """

    stage: str
    done: int
    total: int
    cost: float | None = None


Progress = Callable[[IdentificationProgress], None]
Cancelled = Callable[[], bool]


class Watch:
    """Tells progress, and ends the computation once it is called off.

    Parameters
    ----------
    progress : callable, optional
        Called with every `IdentificationProgress`.
    cancelled : callable, optional
        Whether the computation has been called off.
    """

    def __init__(self, progress: Progress | None = None, cancelled: Cancelled | None = None) -> None:
        self._progress, self._cancelled = progress, cancelled

    def tell(self, stage: str, done: int, total: int, cost: float | None = None) -> None:
        """Tell how far a stage is.

        Raises
        ------
        IdentificationError
            If the identification has been called off.
        """
        if self._cancelled is not None and self._cancelled():
            raise IdentificationError(f"identification cancelled in {stage}")
        if self._progress is not None:
            self._progress(IdentificationProgress(stage, done, total, cost))
