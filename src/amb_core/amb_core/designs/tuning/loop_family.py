"""The loop of one plant with any gains of a PD controller: which are stable, and how large their sensitivity is.

The matrix of the closed loop is affine in K_P and K_D: three closed loops give all others. The sensitivity is
S(z) = (I + P(z) C(z))^-1 with P the sampled plant (amplifiers, sensors, hold and computation delay included) and
C(z) = K_P + K_D (1 - 1/z) / (tau_f (1 - 1/z) + T), see `amb_core.loop.control`. Its peak is the largest of its singular
values: on a grid for charts, and exactly (L-infinity norm, SLICOT AB13DD) for chosen gains.

Sources: ISO 14839-3 (peak sensitivity); Bruinsma, Steinbuch, "A fast algorithm to compute the H-infinity norm of a
transfer function matrix", Systems & Control Letters 14 (1990).
"""

from __future__ import annotations

import numpy as np

from amb_core.ground.parameters import declarations, flatten, part_of, validate
from amb_core.linear.peak import h_infinity_norm
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.loop.linear_control import linear_law
from amb_core.plant.linearise import Linearization, close_loop

FREQUENCIES = 400
"""On the grid: 66 in a decade, the last at half the sample rate; at the first, 1e-6 of that, a soft loop is at rest."""
WITHOUT_LISTS: dict[str, tuple[float, ...]] = {"proportional_gains": (), "derivative_gains": ()}
"""No gains of single axes."""
_MOST = {item.name: item.maximum or np.inf for item in declarations(ControllerParameters)}
LARGEST = _MOST["proportional_gain"], _MOST["derivative_gain"]
"""Gains that a controller takes (A/m, A s/m)."""


class LoopFamily:
    """All PD loops of a linearised plant: the same gains on its radial axes, the given ones on the axial axis.

    Parameters
    ----------
    model : Linearization
        Its discrete plant and its controller are used.
    every_axis : bool, optional
        The same gains on the axial axis, too.
    """

    def __init__(self, model: Linearization, every_axis: bool = False) -> None:
        self.model = model
        given = part_of(ControllerParameters, model.controller.model_dump())
        self._axes = model.discrete.inputs
        packed = pack_gains(given, self._axes)
        labels = model.discrete.output_names
        radial = np.array([every_axis or not label.startswith("z") for label in labels], dtype=float)
        self._fixed = (1.0 - radial) * packed[:, 0], (1.0 - radial) * packed[:, 1]
        self._radial, self._given = radial, given
        loops = [
            close_loop(model.discrete, self.controller(*gains))[1] for gains in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        ]
        self._a = loops[0].a
        self._by_gain = loops[1].a - loops[0].a, loops[2].a - loops[0].a
        frequency = np.geomspace(0.5e-6, 0.5, FREQUENCIES) / model.discrete.sample_time
        self._plant = model.discrete.response(frequency)
        unit = given.model_copy(update={"proportional_gain": 0.0, "derivative_gain": 1.0} | WITHOUT_LISTS)
        self._derivative = -linear_law(unit, 1).response(frequency)[:, 0, 1]  # of the measured position

    def controller(self, proportional: float, derivative: float) -> ControllerParameters:
        """The given controller with these gains on the radial axes (A/m, A s/m)."""
        values = {**flatten(self._given.model_dump()), **WITHOUT_LISTS}
        if self._radial.all():
            values |= {"proportional_gain": proportional, "derivative_gain": derivative}
        else:
            values["proportional_gains"] = (self._radial * proportional + self._fixed[0]).tolist()
            values["derivative_gains"] = (self._radial * derivative + self._fixed[1]).tolist()
        return validate(ControllerParameters, values)

    def stable(self, proportional: float, derivative: float) -> bool:
        """Whether all poles of the closed loop are inside the unit circle."""
        a = self._a + proportional * self._by_gain[0] + derivative * self._by_gain[1]
        return bool(np.abs(np.linalg.eigvals(a)).max() < 1.0)

    def peak(self, proportional: float, derivative: float) -> float:
        """Largest singular value of the sensitivity on the grid (-).

        Infinite if the loop is unstable, or these gains are beyond what a controller takes.
        """
        if proportional > LARGEST[0] or derivative > LARGEST[1] or not self.stable(proportional, derivative):
            return np.inf
        law = np.multiply.outer(self._derivative, self._radial * derivative + self._fixed[1])
        law = law + self._radial * proportional + self._fixed[0]
        inverse = np.eye(self._axes) + self._plant * law[:, np.newaxis, :]
        return float(1.0 / np.linalg.svd(inverse, compute_uv=False)[:, -1].min())

    def exact_peak(self, proportional: float, derivative: float) -> float:
        """The same, exactly: the L-infinity norm of the sensitivity."""
        return h_infinity_norm(close_loop(self.model.discrete, self.controller(proportional, derivative))[1])


def gain_margins(family: LoopFamily, proportional: float, derivative: float) -> tuple[float, float]:
    """Factors on both gains, below and above one, at which the loop becomes unstable; 0 and infinity where none does.

    Each is the first one outwards, to 0.1 percent.
    """
    return _limit(family, proportional, derivative, 1.0 / 1.05), _limit(family, proportional, derivative, 1.05)


def _limit(family: LoopFamily, proportional: float, derivative: float, ratio: float) -> float:
    def stable(factor: float) -> bool:
        return family.stable(factor * proportional, factor * derivative)

    inside = 1.0
    while 1e-3 < inside < 1e3:
        outside = inside * ratio
        if not stable(outside):
            while abs(np.log(outside / inside)) > 1e-3:
                middle = float(np.sqrt(inside * outside))
                inside, outside = (middle, outside) if stable(middle) else (inside, middle)
            return inside
        inside = outside
    return 0.0 if ratio < 1.0 else np.inf
