"""A reference that moves slowly: its response looks like a drift of the bias.

Over a window the bias is a parabola in time. Of a reference that is one too, such as a ramp, the fit cannot separate
the response. So the reference itself is followed where it is as smooth: while it moves, a drift is not judged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SMOOTH = 1e-7  # m: root mean square distance of a reference from a parabola below which its response may be bias


class SlowReference:
    """Follows the reference of one axis where the fit of the linear response cannot separate it from the bias.

    Parameters
    ----------
    samples : int
        Decimated samples of the reference in a window.
    span : int
        Updates over which its motion counts.

    Attributes
    ----------
    smooth : bool
        Whether the response to the reference of the latest window is not known.
    """

    def __init__(self, samples: int, span: int) -> None:
        time = np.linspace(-1.0, 1.0, samples)
        self._parabolas = np.linalg.qr(np.column_stack([np.ones(samples), time, time**2]))[0]
        self._means = np.empty(span)
        self.smooth = False
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._known = 0

    def take(self, reference: NDArray[np.float64]) -> None:
        """Take in the reference of a window, less its origin (m), shape (samples,)."""
        self._reference = reference
        rest = reference - self._parabolas @ (self._parabolas.T @ reference)
        self.smooth = float(rest @ rest) < len(rest) * SMOOTH**2

    def moved(self, part: slice) -> float:
        """How far the unknown part of the reference has moved (m), up to a bias point over these samples."""
        self._means[:-1] = self._means[1:].copy()
        self._means[-1] = self._reference[part].mean() if self.smooth else 0.0
        self._known = min(self._known + 1, len(self._means))
        return float(np.ptp(self._means[-self._known :]))
