"""One mode of a linear model: natural frequency, damping ratio, whirl direction and mode shape.

See `amb_core.linear.model.modes` for what they are, and for the sources.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.linear.model.whirl import Whirl

OSCILLATING = 0.98
"""Damping ratio above which a complex pair counts as not oscillating: its orbit fades before it can turn."""
_TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Mode:
    """One mode: a complex pair of poles, or a real pole.

    Attributes
    ----------
    rate : complex
        s = ln(z) / T (1/s), the pole of the pair with positive imaginary part.
    shape : ndarray, shape (p,)
        Complex displacements at the outputs; the largest is 1.
    gain : float
        Peak gain of its part of the response in displacement or in velocity, over that of the mode where it is largest
        (-); the larger of the two.
    whirl : str
        `forward`, `backward`, `planar`, `mixed`, or `none` for a mode that does not oscillate or has no orbit.
    kind : str
        `translation`, `tilt`, `nutation`, `precession`, `bending` or `axial`; empty where it cannot be decided.
    """

    rate: complex
    shape: NDArray[np.complex128]
    gain: float
    whirl: Whirl
    kind: str = ""

    @property
    def natural_hz(self) -> float:
        """Natural frequency |s| / 2 pi (Hz); of a real pole its rate over 2 pi."""
        return abs(self.rate) / _TWO_PI

    @property
    def damped_hz(self) -> float:
        """Frequency of the oscillation, Im(s) / 2 pi (Hz); 0 for a real pole."""
        return self.rate.imag / _TWO_PI

    @property
    def damping_ratio(self) -> float:
        """-Re(s) / |s|: negative for an unstable mode, 1 and -1 for real poles."""
        return -self.rate.real / abs(self.rate) if self.rate else 0.0

    @property
    def stable(self) -> bool:
        """Whether the mode decays."""
        return self.rate.real < 0.0

    @property
    def oscillates(self) -> bool:
        """Whether it is a complex pair with a damping ratio that lets it turn."""
        return self.rate.imag > 0.0 and abs(self.damping_ratio) < OSCILLATING
