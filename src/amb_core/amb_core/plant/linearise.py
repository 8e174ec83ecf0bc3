"""Linear models of the plant about an operating point, alone and in the loop of a controller.

The averaged plant (`amb_core.plant.averaged`) is differentiated (`amb_core.plant.differences`): the continuous model.
The discrete model holds the control currents over each sample, the computation delay included. With pulse-width
modulation resolved it has the sampling of the modulation too (`amb_core.plant.sampled_amplifiers`), which makes the
coil currents lag less; with the modulation averaged, or where a sample does not hold whole switching periods, it is
exact for the continuous model.

Inputs and outputs are the axes of the machine: i_x, i_y and x, y of one bearing; i_x_a to i_y_b and x_a to y_b of a
rotor in two, then i_z and z of a thrust bearing. A bearing with 1 DOF has i_y and y alone.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 8 (linear bearing, negative stiffness);
ISO 14839-3 (peak sensitivity of the closed loop as a measure of its stability margin).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.extras import extra
from amb_core.loop.control import ControllerParameters, pack_gains, require_one_rate
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.plant.differences import linear_plant
from amb_core.plant.linear_axial import AxialPoint, averaged_axial, axial_point, sampled_axial
from amb_core.plant.operating_point import OperatingPoint, point_at, point_held_by
from amb_core.plant.plant import Plant
from amb_core.plant.rigid_mode import rates_of, rigid_pair
from amb_core.plant.sampled_amplifiers import modulation_is_regular, sampled_plant

if TYPE_CHECKING:
    import control

    from amb_core.step_response import SecondOrder

_FREQUENCIES = 2000


@dataclass(frozen=True)
class Linearization:
    """Linear models about an operating point; all signals are deviations from it.

    Attributes
    ----------
    point : OperatingPoint
        Point of linearisation of the radial axes.
    axial_point : AxialPoint or None
        That along the rotor's axis; None without a thrust bearing.
    controller : ControllerParameters
        The controller of the loop.
    continuous : control.StateSpace
        The averaged plant from i_x, i_y (A) to x, y (m), without the computation delay.
    discrete : control.StateSpace
        The plant at the sample rate, the inputs held over each sample, with the sampling of the modulation.
    closed_loop : control.StateSpace
        From the reference positions r_x, r_y to the positions x, y (m), discrete.
    sensitivity : control.StateSpace
        From a disturbance of the measured positions to the measured positions (m), discrete.
    """

    point: OperatingPoint
    axial_point: AxialPoint | None
    controller: ControllerParameters
    continuous: control.StateSpace
    discrete: control.StateSpace
    closed_loop: control.StateSpace
    sensitivity: control.StateSpace

    @cached_property
    def closed_loop_rates(self) -> NDArray[np.complex128]:
        """Poles of the closed loop as rates s = ln(z) / T (1/s), slowest first; a pole at z = 0 has the rate -inf."""
        rates = rates_of(self.closed_loop.poles(), self.closed_loop.dt)
        return rates[np.argsort(np.abs(rates), kind="stable")]

    @property
    def stable(self) -> bool:
        """Whether all poles of the closed loop are inside the unit circle."""
        return bool(np.abs(self.closed_loop.poles()).max() < 1.0)

    @cached_property
    def peak_sensitivity(self) -> float:
        """Largest singular value of the sensitivity (-), 1 Hz to half the sample rate; meaningless if not `stable`."""
        nyquist = np.pi / self.sensitivity.dt
        frequencies = np.geomspace(2.0 * np.pi, nyquist, _FREQUENCIES)
        at = np.exp(1j * frequencies * self.sensitivity.dt)
        response = np.moveaxis(self.sensitivity(at, squeeze=False), -1, 0)
        return float(np.linalg.norm(response, ord=2, axis=(1, 2)).max())

    def rigid_mode(self, axis: str) -> SecondOrder | None:
        """Natural frequency and damping ratio of the rigid rotor in the loop along `x` or `y`.

        From its pair of poles: two complex ones, or two real ones of a loop with a damping ratio of one or more. None
        if the rotor has no such pair, because one of its poles has met one of the amplifiers or is unstable.
        """
        from amb_core.step_response import SecondOrder

        if axis not in self.closed_loop.output_labels:
            return None
        pair = rigid_pair(self.closed_loop, axis)
        if pair is None:
            return None
        natural = np.sqrt(np.prod(pair).real)
        return SecondOrder(float(natural / (2.0 * np.pi)), float(-pair.sum().real / (2.0 * natural)))


def linearize(
    plant: Plant,
    controller: ControllerParameters | None = None,
    position: NDArray[np.float64] | None = None,
) -> Linearization:
    """Linearise the plant and close the loop.

    Parameters
    ----------
    plant : Plant
        Gives the parameters; its state is neither used nor changed.
    controller : ControllerParameters, optional
        By default the paper's.
    position : ndarray, shape (2,), optional
        Radial rotor position about which to linearise (m). By default the position at which the controller holds the
        rotor, sag included; along its axis it is always that one.

    Raises
    ------
    PlantError
        If there is no such equilibrium within the limits of currents and duty cycles.
    ParameterError
        If the sample rates of plant and controller differ.
    """
    controller = controller or ControllerParameters()
    require_one_rate(controller.sample_rate, 1.0 / plant.sample_time)
    point = point_held_by(controller, plant) if position is None else point_at(position, plant)
    along_axis = axial_point(controller, plant)
    continuous = linear_plant(plant, point)
    regular = modulation_is_regular(plant.parameters)
    discrete = sampled_plant(plant, point) if regular else _discretise(continuous, plant)
    if plant.axial is not None and along_axis is not None:
        axial = averaged_axial(plant, plant.axial, along_axis)
        sampled = sampled_axial(plant, plant.axial, along_axis) if regular else _discretise(axial, plant)
        continuous, discrete = _beside(continuous, axial), _beside(discrete, sampled)
    return Linearization(point, along_axis, controller, continuous, discrete, *close_loop(discrete, controller))


def _beside(first: control.StateSpace, second: control.StateSpace) -> control.StateSpace:
    """Two models that do not act on each other as one, inputs and outputs of the first first."""
    with extra("control"):
        import control

    return control.StateSpace(
        *(linalg.block_diag(getattr(first, name), getattr(second, name)) for name in "ABCD"), first.dt,
        states=[*first.state_labels, *second.state_labels], inputs=[*first.input_labels, *second.input_labels],
        outputs=[*first.output_labels, *second.output_labels], name=first.name,
    )  # fmt: skip


def _discretise(continuous: control.StateSpace, plant: Plant) -> control.StateSpace:
    """Inputs held over each sample, starting after the computation delay; with a delay, earlier inputs are states."""
    with extra("control"):
        import control

    delay = plant.parameters.converters.computation_delay * plant.sample_time
    if delay == 0.0:
        return continuous.sample(plant.sample_time, method="zoh", name="plant")
    order, inputs = continuous.nstates, continuous.ninputs
    late = continuous.sample(delay, method="zoh")
    if delay < plant.sample_time:
        rest = continuous.sample(plant.sample_time - delay, method="zoh")
        rest_a, rest_b = rest.A, rest.B
    else:
        rest_a, rest_b = np.eye(order), np.zeros((order, inputs))
    a = np.zeros((order + inputs, order + inputs))
    a[:order, :order], a[:order, order:] = rest_a @ late.A, rest_a @ late.B
    b = np.vstack([rest_b, np.eye(inputs)])
    return control.StateSpace(
        a, b, np.hstack([continuous.C, np.zeros((inputs, inputs))]), continuous.D, plant.sample_time,
        states=[*continuous.state_labels, *(f"held_{label}" for label in continuous.input_labels)],
        inputs=continuous.input_labels, outputs=continuous.output_labels, name="plant",
    )  # fmt: skip


def close_loop(plant: control.StateSpace, controller: KnownController) -> tuple[control.StateSpace, control.StateSpace]:
    """Loop of a discrete plant and a controller without its limits.

    A linear controller adds its states to those of the plant. The PD law has one per axis: with a and w the pole and
    the weight of the derivative filter, the derivative d of u is d[k] = w (a - 1) s[k] + w u[k], with s[k+1] = a s[k] +
    u[k].

    Parameters
    ----------
    plant : control.StateSpace
        From control currents (A) to positions (m), without direct feed-through.
    controller : KnownController
        The PD law, whose `derivative_on` decides whether u is r - y or -y, or a linear one.

    Returns
    -------
    closed_loop : control.StateSpace
        From reference positions r_x, r_y to x, y (m).
    sensitivity : control.StateSpace
        From a disturbance w_x, w_y of the measurement to the measured x, y (m).
    """
    with extra("control"):
        import control

    if isinstance(controller, LinearControl):
        return _close_linear_loop(plant, controller)
    axes = plant.ninputs
    gains = pack_gains(controller, axes)
    proportional, derivative, pole, weight, on_error = (np.diag(column) for column in gains[:, :5].T)
    order = plant.nstates
    direct = proportional + derivative @ weight  # from -y to i
    a = np.zeros((order + axes, order + axes))
    a[:order, :order] = plant.A - plant.B @ direct @ plant.C
    a[:order, order:] = plant.B @ derivative @ weight @ (pole - np.eye(axes))
    a[order:, :order] = -plant.C
    a[order:, order:] = pole
    output = np.hstack([plant.C, np.zeros((axes, axes))])
    labels = plant.output_labels
    states = [*plant.state_labels, *(f"derivative_{label}" for label in labels)]
    from_reference = np.vstack([plant.B @ (proportional + on_error @ derivative @ weight), on_error])
    from_measurement = np.vstack([-plant.B @ direct, -np.eye(axes)])
    closed_loop = control.StateSpace(
        a, from_reference, output, np.zeros((axes, axes)), plant.dt,
        states=states, inputs=[f"r_{label}" for label in labels], outputs=labels, name="closed_loop",
    )  # fmt: skip
    sensitivity = control.StateSpace(
        a, from_measurement, output, np.eye(axes), plant.dt,
        states=states, inputs=[f"w_{label}" for label in labels], outputs=labels, name="sensitivity",
    )  # fmt: skip
    return closed_loop, sensitivity


def _close_linear_loop(
    plant: control.StateSpace, controller: LinearControl
) -> tuple[control.StateSpace, control.StateSpace]:
    """As `close_loop`: x+ = (A + B D_y C) x + B C_c w + B D_r r, w+ = B_y C x + A_c w + B_r r, with w of the law."""
    with extra("control"):
        import control

    axes, law = plant.ninputs, controller.model
    controller.require_axes(axes)
    of_errors = law.b.shape[1] == axes
    (b_reference, d_reference), (b_position, d_position) = (
        ((law.b, law.d), (-law.b, -law.d))
        if of_errors
        else ((law.b[:, :axes], law.d[:, :axes]), (law.b[:, axes:], law.d[:, axes:]))
    )
    a = np.block([[plant.A + plant.B @ d_position @ plant.C, plant.B @ law.c], [b_position @ plant.C, law.a]])
    output = np.hstack([plant.C, np.zeros((axes, law.order))])
    labels = plant.output_labels
    states = [*plant.state_labels, *(f"controller_{number}" for number in range(law.order))]
    closed_loop = control.StateSpace(
        a, np.vstack([plant.B @ d_reference, b_reference]), output, np.zeros((axes, axes)), plant.dt,
        states=states, inputs=[f"r_{label}" for label in labels], outputs=labels, name="closed_loop",
    )  # fmt: skip
    sensitivity = control.StateSpace(
        a, np.vstack([plant.B @ d_position, b_position]), output, np.eye(axes), plant.dt,
        states=states, inputs=[f"w_{label}" for label in labels], outputs=labels, name="sensitivity",
    )  # fmt: skip
    return closed_loop, sensitivity
