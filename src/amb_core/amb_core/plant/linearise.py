"""Linear models of the plant about an operating point, alone and in the loop of the PD controller.

The averaged plant (`amb_core.plant.averaged`) is differentiated by central differences of its right-hand side. Its
fluxes obey E^T phi = 0, so one flux of each circuit is left out: it is minus the sum of the others. With the control
currents held over each sample, the computation delay included, the discrete model is exact for the continuous one.

A rotor in two bearings has inputs and outputs of both: i_x, i_y, x, y of bearing A, then i_x_b, i_y_b, x_b, y_b of
bearing B, whose loop is closed by the plant's own controller. A bearing with 1 DOF has i_y and y alone.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 8 (linear bearing, negative stiffness);
ISO 14839-3 (peak sensitivity of the closed loop as a measure of its stability margin).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters, pack_gains, require_one_rate
from amb_core.plant.averaged import AveragedPlant, flux_embedding
from amb_core.plant.network import POLES, active_coils
from amb_core.plant.operating_point import OperatingPoint, point_at, point_held_by
from amb_core.plant.plant import Plant

if TYPE_CHECKING:
    import control

    from amb_core.step_response import SecondOrder

_RELATIVE_STEP = 1e-4
"""Step of the differences over air gap, 1 m/s, 1 A and the flux that 1 A makes; rounding then takes 1e-11."""
_FREQUENCIES = 2000


@dataclass(frozen=True)
class Linearization:
    """Linear models about an operating point; all signals are deviations from it.

    Attributes
    ----------
    point : OperatingPoint
        Point of linearisation.
    controller : ControllerParameters
        The controller of the loop.
    continuous : control.StateSpace
        The plant from i_x, i_y (A) to x, y (m), without the computation delay.
    discrete : control.StateSpace
        The same at the sample rate, the inputs held over each sample.
    closed_loop : control.StateSpace
        From the reference positions r_x, r_y to the positions x, y (m), discrete.
    sensitivity : control.StateSpace
        From a disturbance of the measured positions to the measured positions (m), discrete.
    """

    point: OperatingPoint
    controller: ControllerParameters
    continuous: control.StateSpace
    discrete: control.StateSpace
    closed_loop: control.StateSpace
    sensitivity: control.StateSpace

    @cached_property
    def closed_loop_rates(self) -> NDArray[np.complex128]:
        """Poles of the closed loop as rates s = ln(z) / T (1/s), slowest first; a pole at z = 0 has the rate -inf."""
        rates = _rates(self.closed_loop.poles(), self.closed_loop.dt)
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
        """Natural frequency and damping ratio of the rotor in the loop along `x` or `y`; None if no mode oscillates."""
        from amb_core.step_response import SecondOrder

        poles, vectors = np.linalg.eig(self.closed_loop.A)
        rates = _rates(poles, self.closed_loop.dt)
        swinging = np.flatnonzero((rates.imag > 0.0) & (poles.imag != 0.0))
        outputs = self.closed_loop.output_labels
        if len(swinging) == 0 or axis not in outputs:
            return None
        # The amplifiers are far faster than the rotor, so its modes, one per axis, are the slowest oscillating ones.
        slowest = swinging[np.argsort(np.abs(rates[swinging]))][: len(outputs)]
        shares = np.abs(self.closed_loop.C @ vectors[:, slowest])
        # Two bearings share modes evenly: then it is the slowest.
        share = np.round(shares[outputs.index(axis)] / shares.sum(axis=0), 3)
        rate = rates[slowest[np.argmax(share)]]
        return SecondOrder(float(np.abs(rate) / (2.0 * np.pi)), float(-rate.real / np.abs(rate)))


def linearize(
    plant: Plant,
    controller: ControllerParameters | None = None,
    position: NDArray[np.float64] | None = None,
) -> Linearization:
    """Linearise the plant and close the loop.

    Parameters
    ----------
    plant : Plant
        Gives the parameters; its state is neither used nor changed. `switching` has no effect here.
    controller : ControllerParameters, optional
        By default the paper's.
    position : ndarray, shape (2,), optional
        Rotor position about which to linearise (m). By default the position at which the controller holds the rotor,
        sag included.

    Raises
    ------
    PlantError
        If there is no such equilibrium within the limits of currents and duty cycles.
    ParameterError
        If the sample rates of plant and controller differ.
    """
    controller = controller or ControllerParameters()
    require_one_rate(controller, 1.0 / plant.sample_time)
    point = point_held_by(controller, plant) if position is None else point_at(position, plant)
    continuous = linear_plant(plant, point)
    discrete = _discretise(continuous, plant)
    controllers = [controller, plant.parameters.controller_b][: plant.bearings]
    return Linearization(point, controller, continuous, discrete, *close_loop(discrete, controllers))


def linear_plant(plant: Plant, point: OperatingPoint) -> control.StateSpace:
    """The plant from control currents (A) to measured positions (m) about an operating point, continuous."""
    import control  # takes a second to import: only on use

    averaged = AveragedPlant(plant)
    kept, embedding = _independent_states(averaged)
    axes = [axis for axis in range(2 * plant.bearings) if "xy"[axis % 2] in plant.axes]
    steps = _RELATIVE_STEP * np.concatenate([_scales(averaged)[kept], np.ones(len(axes))])
    columns = []
    for number, step in enumerate(steps):
        deviation = np.zeros(len(steps))
        deviation[number] = step
        change, control_current = embedding @ deviation[: len(kept)], np.zeros(2 * plant.bearings)
        control_current[axes] = deviation[len(kept) :]
        ahead, behind = (
            averaged.derivative(point.state + side * change, point.current_reference + side * control_current)
            for side in (1.0, -1.0)
        )
        columns.append((ahead - behind)[kept] / (2.0 * step))
    a, b = np.split(np.column_stack(columns), [len(kept)], axis=1)
    c = averaged.sensors()[axes] @ embedding
    labels = [f"{'xy'[axis % 2]}{'_b' if axis > 1 else ''}" for axis in axes]
    states = [averaged.names[n] for n in kept]
    bandwidth = plant.parameters.sensor.bandwidth
    if bandwidth > 0.0:
        rate = 2.0 * np.pi * bandwidth
        a = np.block([[a, np.zeros((len(a), len(axes)))], [rate * c, -rate * np.eye(len(axes))]])
        b = np.vstack([b, np.zeros((len(axes), len(axes)))])
        c = np.hstack([np.zeros_like(c), np.eye(len(axes))])
        states += [f"sensed_{label}" for label in labels]
    return control.StateSpace(
        a, b, c, np.zeros((len(axes), len(axes))),
        states=states, inputs=[f"i_{label}" for label in labels], outputs=labels, name="plant",
    )  # fmt: skip


def _discretise(continuous: control.StateSpace, plant: Plant) -> control.StateSpace:
    """Inputs held over each sample, starting after the computation delay; with a delay, earlier inputs are states."""
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


def close_loop(
    plant: control.StateSpace, controllers: Sequence[ControllerParameters]
) -> tuple[control.StateSpace, control.StateSpace]:
    """Loop of a discrete plant and PD controllers without their limits.

    With a and w the pole and the weight of the derivative filter, the derivative d of u is d[k] = w (a - 1) s[k] +
    w u[k], s[k+1] = a s[k] + u[k].

    Parameters
    ----------
    plant : control.StateSpace
        From control currents (A) to positions (m), without direct feed-through; as many axes per controller.
    controllers : sequence of ControllerParameters
        Gains and filter for each bearing; `derivative_on` decides whether u is r - y or -y.

    Returns
    -------
    closed_loop : control.StateSpace
        From reference positions r_x, r_y to x, y (m).
    sensitivity : control.StateSpace
        From a disturbance w_x, w_y of the measurement to the measured x, y (m).
    """
    import control

    axes = plant.ninputs
    gains = np.repeat([pack_gains(controller) for controller in controllers], axes // len(controllers), axis=0)
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


def _rates(poles: NDArray[np.complex128], sample_time: float) -> NDArray[np.complex128]:
    """ln(z) / T, with -inf for z = 0."""
    with np.errstate(divide="ignore"):
        return np.log(np.abs(poles)) / sample_time + 1j * np.angle(poles) / sample_time


def _independent_states(averaged: AveragedPlant) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Indices of the states without constraints, and the map from these states to all states."""
    plant = averaged.plant
    poles, fluxes = flux_embedding(plant)
    left_out = np.setdiff1d(np.arange(POLES), poles)
    # Without integral gain the integral parts are constant: they are not states of the linear model.
    integrating = active_coils(plant.parameters.magnetic_circuit) if plant.parameters.amplifier.integral_gain else ()
    embedding = np.eye(averaged.size)
    kept = np.ones(averaged.size, dtype=bool)
    for bearing in range(plant.bearings):
        first = averaged.flux[bearing].start
        embedding[np.ix_(first + np.arange(POLES), first + poles)] = fluxes
        kept[first + left_out] = False
        memory = np.arange(averaged.memory[bearing].start, averaged.memory[bearing].stop)
        for term in memory.reshape(-1, POLES):  # memories sum to zero as the fluxes do
            embedding[np.ix_(term, term[poles])] = fluxes
            kept[term[left_out]] = False
        kept[averaged.integral[bearing]] = False
        kept[averaged.integral[bearing].start + np.array(integrating, dtype=np.intp)] = True
    if "x" not in plant.axes:
        kept[[averaged.coordinates.start, averaged.rates.start]] = False
    return np.flatnonzero(kept), embedding[:, kept]


def _scales(averaged: AveragedPlant) -> NDArray[np.float64]:
    circuit, network = averaged.plant.parameters.magnetic_circuit, averaged.plant.network
    scales = np.ones(averaged.size)
    for bearing in range(averaged.plant.bearings):
        # Fluxes, circulating fluxes and memories are contiguous
        fluxes = slice(averaged.flux[bearing].start, averaged.integral[bearing].start)
        scales[fluxes] = circuit.turns_per_pole / (network.gap_reluctance * circuit.air_gap)
    scales[averaged.coordinates] = circuit.air_gap
    return scales
