"""The result of a distortion measurement: responses and levels over frequency, and a number for each axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.results import Result, plain, rows_by_axis

Method = Literal["robust", "fast"]


@dataclass(frozen=True, eq=False, repr=False)
class Distortion(Result):
    """Linear response, noise and distortions of the position; levels are peak amplitudes of lines in one experiment.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes, in the order of the arrays below.
    frequency, odd_frequency, even_frequency : ndarray, shapes (excited,), (odd,), (even,)
        Frequencies of the excited lines, of the odd lines that are not, and of the even lines that are not (Hz).
    closed_loop : ndarray, shape (excited, axes, axes)
        T: from the references to the positions (-); NaN for a reference that does not move, and for all where the
        references move only together.
    deviation : ndarray, shape (excited, axes, axes)
        Standard deviation of T from noise and distortions together (-).
    plant : ndarray, shape (excited, axes, axes)
        G: from the control currents to the positions (m/A); NaN unless all references move, independently.
    linear : ndarray, shape (excited, axes)
        The linear response T R, root mean square over the experiments (m).
    stochastic : ndarray, shape (excited, axes)
        Distortions at the excited lines (m); by the fast method those of the nearest lines that are not excited.
    odd, even : ndarray, shapes (odd, axes), (even, axes)
        Distortions at the odd and even lines that are not excited (m).
    noise : ndarray, shape (excited, axes)
        Noise at the excited lines, of the mean over the periods (m).
    ratio : ndarray, shape (axes,)
        Root mean square of all distortions over that of the linear response (-); NaN for an axis whose reference does
        not move.
    upper_ratio : ndarray, shape (axes,)
        Upper 95 % confidence bound of `ratio` for the class of references of which the experiments are drawn, from its
        spread between them (-); NaN with fewer than two independent ones.
    odd_ratio, even_ratio : ndarray, shape (axes,)
        The parts of odd and even order, likewise (-); NaN if even lines are excited, as the orders then share lines,
        and for the odd order if it is hidden.
    noise_ratio : ndarray, shape (axes,)
        The noise of one period, likewise (-).
    method : {"robust", "fast"}
        Whether distortions at excited lines were measured, or taken from the lines beside them.
    complete : bool
        False if all odd lines of the band are excited, once: distortion of odd order is then hidden, and `ratio` holds
        only that of even order.
    experiments : int
        Number of realisations, or experiments with references of their own.
    periods : int
        Smallest number of periods measured in one of them.
    period : float
        Period of the reference (s).
    """

    axes: tuple[str, ...]
    frequency: NDArray[np.float64]
    odd_frequency: NDArray[np.float64]
    even_frequency: NDArray[np.float64]
    closed_loop: NDArray[np.complex128]
    deviation: NDArray[np.float64]
    plant: NDArray[np.complex128]
    linear: NDArray[np.float64]
    stochastic: NDArray[np.float64]
    odd: NDArray[np.float64]
    even: NDArray[np.float64]
    noise: NDArray[np.float64]
    ratio: NDArray[np.float64]
    upper_ratio: NDArray[np.float64]
    odd_ratio: NDArray[np.float64]
    even_ratio: NDArray[np.float64]
    noise_ratio: NDArray[np.float64]
    method: Method
    complete: bool
    experiments: int
    periods: int
    period: float

    @property
    def decibel(self) -> NDArray[np.float64]:
        """`ratio` in dB, shape (axes,); minus infinity where no distortion was found."""
        with np.errstate(divide="ignore"):
            return np.asarray(20.0 * np.log10(self.ratio))

    @property
    def brief(self) -> str:
        """The number of each axis in a few words."""
        parts = [
            f"{_percent(ratio)} on {axis}"
            for axis, ratio in zip(self.axes, self.ratio, strict=True)
            if not math.isnan(ratio)
        ]
        return f"{self._measured} {', '.join(parts)}"

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The numbers of each axis."""
        return rows_by_axis(self.as_dict())

    @property
    def summary(self) -> str:
        """One line for people."""
        parts = []
        for axis, name in enumerate(self.axes):
            if math.isnan(self.ratio[axis]):
                parts.append(f"{name} not excited")
                continue
            orders = [f"{self.decibel[axis]:.0f} dB" if self.ratio[axis] > 0.0 else "none beyond the noise"]
            if math.isfinite(self.upper_ratio[axis]):
                orders.append(f"at most {_percent(self.upper_ratio[axis])} at 95 %")
            if not math.isnan(self.odd_ratio[axis]):
                orders.append(f"even {_percent(self.even_ratio[axis])}, odd {_percent(self.odd_ratio[axis])}")
            parts.append(f"{name} {_percent(self.ratio[axis])} ({'; '.join(orders)})")
        return f"nonlinear {self._measured} over the linear response: {', '.join(parts)}"

    @property
    def _measured(self) -> str:
        return "distortion" if self.complete else "distortion of even order, with that of odd order hidden,"

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """Numbers of each axis, as plain values for strict JSON; None where there is none.

        Returns
        -------
        dict of str to dict of str to float or None
            Values by axis and name.
        """
        return {
            name: {
                "distortion_percent": plain(100.0 * self.ratio[axis]),
                "distortion_db": plain(self.decibel[axis]),
                "distortion_upper_percent": plain(100.0 * self.upper_ratio[axis]),
                "even_percent": plain(100.0 * self.even_ratio[axis]),
                "odd_percent": plain(100.0 * self.odd_ratio[axis]),
                "noise_percent": plain(100.0 * self.noise_ratio[axis]),
            }
            for axis, name in enumerate(self.axes)
        }


def _percent(ratio: float) -> str:
    return f"{100.0 * ratio:.2g} %"
