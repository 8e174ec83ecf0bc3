"""The closed loop of an identified model with a linear controller, opened for perturbations.

With the plant P from control currents u to positions y and the controller u = -C y + w_u, y = P u + w_y, all transfers
of robustness are parts of one system from the perturbations (w_u, w_y) to the signals behind them (u, y):

    u = S_i w_u - C S_o w_y,    y = P S_i w_u + S_o w_y,    S_o = (I + P C)^-1,    S_i = (I + C P)^-1.

The computation delay is part of the model, which is identified from the currents of step k to the positions of step k;
a longer one is added by `extra_delay`, whole steps to the controller and the rest to the plant (`late_plant`).

Source: S. Skogestad and I. Postlethwaite, Multivariable Feedback Control, 2nd ed., Wiley, 2005, section 4.7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from amb_core.ground.errors import RobustnessError
from amb_core.ground.sample_times import difference, same_sample_time
from amb_core.identification.closed_loop import loop_axes
from amb_core.linear import Arrays, Complexes, LinearSystem, connections
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.loop.linear_control import linear_law
from amb_core.robustness.late_plant import late_model

MARGIN = 1e-9
"""A loop whose largest pole has a magnitude of 1 - this or more is not taken as stable: rounding could hide it."""


@dataclass(frozen=True, eq=False)
class Feedback:
    """A plant and a controller in negative feedback.

    Attributes
    ----------
    plant : LinearSystem
        From control currents (A) to positions (m), strictly proper.
    controller : LinearSystem
        C of u = -C y, from positions (m) to control currents (A).
    axes : tuple of str
        Names of the outputs.

    Raises
    ------
    RobustnessError
        If the two do not fit together.
    """

    plant: LinearSystem
    controller: LinearSystem
    axes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        (p, m), law = self.plant.d.shape, self.controller.d.shape
        if law != (m, p) or np.any(self.plant.d):
            raise RobustnessError(
                f"a plant of {m} inputs and {p} outputs without feedthrough needs a controller of {p} inputs and {m} "
                f"outputs; this one has {law[1]} and {law[0]}, and the plant's largest feedthrough is "
                f"{np.abs(self.plant.d).max(initial=0.0):g}"
            )
        if not same_sample_time(self.controller.sample_time, self.plant.sample_time):
            raise RobustnessError(
                f"plant and controller must have one sample time: {self.plant.sample_time:g} s and "
                f"{self.controller.sample_time:g} s; {difference(self.controller.sample_time, self.plant.sample_time)}"
            )
        if not self.axes:
            object.__setattr__(self, "axes", tuple(f"y_{number + 1}" for number in range(p)))

    @property
    def inputs(self) -> int:
        """Number of control currents m."""
        return self.plant.b.shape[1]

    @property
    def outputs(self) -> int:
        """Number of positions p."""
        return len(self.plant.c)

    @cached_property
    def closed(self) -> LinearSystem:
        """From (w_u, w_y) to (u, y), shape (m + p, m + p); its states are those of plant and controller."""
        return self.opened(np.zeros((self.plant.order, 0)), np.zeros((0, self.plant.order)))

    def opened(self, into_states: Arrays, from_states: Arrays) -> LinearSystem:
        """The closed loop with further perturbations of the plant's states.

        Parameters
        ----------
        into_states, from_states : ndarray, shapes (n, e), (s, n)
            How e further inputs act on the next state of the plant, and s further outputs as seen from its state (-).

        Returns
        -------
        LinearSystem
            From (w_u, w_y, w_x) to (u, y, z_x).
        """
        plant = self.plant
        extended = LinearSystem(
            plant.a,
            np.hstack([plant.b, into_states]),
            np.vstack([plant.c, from_states]),
            np.zeros((self.outputs + len(from_states), self.inputs + into_states.shape[1])),
            plant.sample_time,
        )
        return connections.feedback(extended, self.controller.scaled(-1.0, 1.0))

    def action(self, frequency: Arrays) -> Complexes:
        """C S_o, from references to control currents.

        Parameters
        ----------
        frequency : ndarray, shape (f,)
            Frequencies (Hz).

        Returns
        -------
        ndarray of complex, shape (f, m, p)
            The response (A/m).
        """
        return np.ascontiguousarray(self.closed.response(frequency)[:, : self.inputs, self.inputs :])

    @property
    def stable(self) -> bool:
        """Whether all poles of the loop lie inside the unit circle, by more than rounding could hide."""
        return self.closed.radius < 1.0 - MARGIN

    @property
    def unstable_frequencies(self) -> Arrays:
        """Frequencies (Hz) of the poles for which the loop is not stable, shape (k,)."""
        poles = self.closed.poles()
        angles = np.angle(poles[np.abs(poles) >= 1.0 - MARGIN])
        return np.asarray(np.abs(angles) / (2.0 * np.pi * self.plant.sample_time))

    def require_stable(self) -> None:
        """Check that the loop is stable.

        Raises
        ------
        RobustnessError
            If it is not; the message names the pole.
        """
        if not self.stable:
            pole = self.closed.poles()[0]
            rate = np.log(complex(pole)) / self.plant.sample_time
            raise RobustnessError(
                f"the closed loop of model and controller is not stable: pole z = {pole:.6g} of magnitude "
                f"{abs(pole):.9g}, {abs(rate.imag) / (2.0 * np.pi):.4g} Hz; a stable loop has no margins without it. "
                "Change the controller, or the model if the bearing runs with this controller"
            )

    @property
    def output_sensitivity(self) -> LinearSystem:
        """S_o = (I + P C)^-1."""
        return self.closed.part(slice(self.inputs, None), slice(self.inputs, None))

    @property
    def input_sensitivity(self) -> LinearSystem:
        """S_i = (I + C P)^-1."""
        return self.closed.part(slice(self.inputs), slice(self.inputs))

    @property
    def complementary(self) -> LinearSystem:
        """T_o = I - S_o."""
        s = self.output_sensitivity
        return s.scaled(-1.0, 1.0).plus(np.eye(self.outputs))

    def at_axis(self, axis: int) -> LinearSystem:
        """The loop opened at one output, all others closed: L = 1/S_axis - 1, from -(input of the controller) to y.

        Parameters
        ----------
        axis : int
            Index of the output.

        Returns
        -------
        LinearSystem
            L, of one input and one output.
        """
        one = [self.inputs + axis]
        s = self.closed.part(one, one)
        # y = S w; as a loop y = w - L y, so L = S^-1 - 1: the inverse of S, whose D is 1.
        inverse_d = 1.0 / s.d
        return s.with_matrices(s.a - s.b @ inverse_d @ s.c, s.b @ inverse_d, -inverse_d @ s.c, inverse_d - 1.0)

    def with_plant(self, model: StateSpaceModel) -> Feedback:
        """The same controller with another model.

        Parameters
        ----------
        model : StateSpaceModel
            The other model, of the same signals.

        Returns
        -------
        Feedback
            The loop of it.
        """
        return replace(self, plant=model)


def feedback_of(model: StateSpaceModel, controller: KnownController, extra_delay: float = 0.0) -> Feedback:
    """The loop of a model and a controller, as `closed_loop_poles` forms it.

    Parameters
    ----------
    model : StateSpaceModel
        Identified model without feedthrough.
    controller : KnownController
        The PD controller or any linear one; limits are left out.
    extra_delay : float, optional
        Steps by which the currents come later than in the data of the model (steps); fractions count.

    Returns
    -------
    Feedback
        The loop; it may be unstable.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    RobustnessError
        If the delay has a fraction of a step and the model a pole at z = 0.
    """
    whole, fraction = divmod(extra_delay, 1.0)
    law = law_from_positions(controller, loop_axes(model, controller), int(whole))
    return Feedback(late_model(model, fraction), law, tuple(model.output_names))


def law_from_positions(controller: KnownController, axes: int, extra_delay: int = 0) -> LinearSystem:
    """C of u = -C y of a controller for a number of axes; errors as for `feedback_of`."""
    control = linear_law(controller, axes).part(slice(None), slice(axes, None)).scaled(-1.0, 1.0)
    for _ in range(extra_delay):
        control = control.delayed()
    return control


def is_same_law(first: KnownController, second: KnownController, axes: int) -> bool:
    """Whether two controllers answer positions alike, whatever their limits."""
    laws = [law_from_positions(one, axes) for one in (first, second)]
    return same_sample_time(laws[0].sample_time, laws[1].sample_time) and all(
        np.array_equal(getattr(laws[0], name), getattr(laws[1], name)) for name in "abcd"
    )
