"""Where in the plane of K_P and K_D the loop is stable, and how large the peak of its sensitivity is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.tuning.gains import centred
from amb_core.designs.tuning.loop_family import LoopFamily
from amb_core.ground.progress import Progress
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant import Plant, PlantParameters, linearize

POINTS = 64
"""Gains along each side of the chart."""
NEAREST, FARTHEST = 3.0, 30.0
"""Each side of the chart reaches at least and at most so many times above and below the chosen gain."""


@dataclass(frozen=True)
class StabilityChart:
    """Peak sensitivity over the gains.

    Attributes
    ----------
    proportional, derivative : ndarray, shape (n,)
        K_P (A/m) and K_D (A s/m).
    peak : ndarray, shape (n, n)
        Peak sensitivity (-), a row for each K_D; infinite where the loop is unstable.
    chosen : tuple of float
        K_P and K_D of the controller on its first axis.
    chosen_peak : float
        Peak sensitivity of the given controller, exactly; infinite if it does not stabilise the loop.
    axis : str
        Name of the first axis.
    alike : bool
        Whether the controller has the chosen gains on all radial axes, as the chart has.
    """

    proportional: NDArray[np.float64]
    derivative: NDArray[np.float64]
    peak: NDArray[np.float64]
    chosen: tuple[float, float]
    chosen_peak: float
    axis: str
    alike: bool


def stability_chart(
    parameters: PlantParameters,
    controller: ControllerParameters,
    points: int = POINTS,
    progress: Progress | None = None,
) -> StabilityChart:
    """The chart of a machine, linearised about the centre of its bearings.

    Parameters
    ----------
    parameters, controller : PlantParameters, ControllerParameters
        The loop. The chart has the same gains on all radial axes; those of the axial axis stay as they are.
    points : int, optional
        Gains along each side.
    progress : callable, optional
        Called after each row, see `amb_core.ground.progress.Progress`.

    Raises
    ------
    PlantError
        If the currents cannot hold the rotor in the centre.
    """
    plant = Plant(parameters)
    packed = pack_gains(controller, len(plant.machine.axes))
    chosen = float(packed[0, 0]), float(packed[0, 1])
    alike = bool((packed[: 2 * plant.bearings, :2] == chosen).all())
    given = controller.model_copy(update={"nominal_reference": ()})
    if not parameters.rotor.axial:
        given = centred(parameters, given)
    model = linearize(plant, given, np.zeros(2))
    family = LoopFamily(model)
    proportional, derivative = _sides(family, chosen, points)
    peak = np.empty((points, points))
    for row, k_d in enumerate(derivative):
        peak[row] = [family.peak(float(k_p), float(k_d)) for k_p in proportional]
        if progress is not None:
            progress("chart", row + 1, points)
    axis = plant.machine.axis_names[0]
    return StabilityChart(proportional, derivative, peak, chosen, model.peak_sensitivity, axis, alike)


def _sides(family: LoopFamily, chosen: tuple[float, float], points: int) -> list[NDArray[np.float64]]:
    """Gains along both sides, a constant factor apart, to where the stable set ends along each through the chosen."""
    k_p, k_d = (max(gain, 1e-6) for gain in chosen)
    along = (
        (k_p, lambda factor: family.stable(factor * k_p, k_d)),
        (k_d, lambda factor: family.stable(k_p, factor * k_d)),
    )
    return [gain * np.geomspace(1.0 / _reach(stable, -1.0), _reach(stable, 1.0), points) for gain, stable in along]


def _reach(stable: Callable[[float], bool], direction: float) -> float:
    """A factor a little beyond the last stable one in a direction, from `NEAREST` to `FARTHEST`."""
    tried = np.geomspace(1.0, FARTHEST, 40)
    last = max((float(factor) for factor in tried if stable(float(factor**direction))), default=1.0)
    return max(NEAREST, min(1.5 * last, FARTHEST))
