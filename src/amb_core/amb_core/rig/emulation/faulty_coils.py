"""Amplifiers and coils that are dead, weak, or wrongly wired."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.rig.emulation.faulty_signals import FaultySignals, named
from amb_core.rig.emulation.parameters import CoilFaultParameters


class FaultyCoils:
    """What becomes of control current references on their way to the magnets.

    Parameters
    ----------
    axes : tuple of str
        Names of the axes.
    faults : CoilFaultParameters
        The faults.
    sample_rate : float
        Of the references (Hz).

    Raises
    ------
    ParameterError
        If a fault names an axis that the machine lacks.
    """

    def __init__(self, axes: tuple[str, ...], faults: CoilFaultParameters, sample_rate: float) -> None:
        self._faults, self._right = faults, faults == CoilFaultParameters()
        self._signals = FaultySignals("coil", faults, axes, sample_rate)
        self._dead, self._shifted, self._weak = (
            named("coil", name, getattr(faults, name), axes) for name in ("dead", "shifted", "weak")
        )

    def applied(self, currents: NDArray[np.float64]) -> NDArray[np.float64]:
        """Control currents (A), shape (axes,), for those that the target asks for."""
        if self._right:
            return currents
        flowing = currents.copy()
        self._signals.apply(flowing)
        flowing[self._shifted] += self._faults.shift
        flowing[self._weak] = np.clip(flowing[self._weak], -self._faults.limit, self._faults.limit)
        flowing[self._dead] = 0.0
        return flowing
