"""Linear models of the plant about an operating point, alone and in the loop of the PD controller.

The averaged plant (`amb_core.plant.averaged`) is differentiated by central differences of its right-hand side. Its
fluxes obey E^T phi = 0, so one flux of each circuit is left out: it is minus the sum of the others. With the control
currents held over each sample, the discrete model is exact for the continuous one.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 8 (linear bearing, negative stiffness);
ISO 14839-3 (peak sensitivity of the closed loop as a measure of its stability margin).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.control import ControllerParameters, pack_gains
from amb_core.errors import PlantError
from amb_core.plant.averaged import FLUX, INTEGRAL, POSITION, STATE_NAMES, STATE_SIZE, averaged_rates
from amb_core.plant.network import POLES, flux_constraints
from amb_core.plant.operating_point import OperatingPoint, point_at, point_held_by
from amb_core.plant.plant import Plant

if TYPE_CHECKING:
    import control

    from amb_core.step_response import SecondOrder

AXES = ("x", "y")
_RELATIVE_STEP = 1e-4
"""Step of the differences over air gap, 1 m/s, 1 A and the flux that 1 A makes; rounding then takes 1e-11."""
_FREQUENCIES = 2000


@dataclass(frozen=True)
class Linearization:
    """Linear models about an operating point; all signals are deviations from it.

    Attributes
    ----------
    point : OperatingPoint
        Where the plant was linearised.
    controller : ControllerParameters
        The controller of the loop.
    continuous : control.StateSpace
        The plant from i_x, i_y (A) to x, y (m).
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
        response = np.moveaxis(self.sensitivity(np.exp(1j * frequencies * self.sensitivity.dt)), -1, 0)
        return float(np.linalg.norm(response, ord=2, axis=(1, 2)).max())

    def rigid_mode(self, axis: str) -> SecondOrder | None:
        """Natural frequency and damping ratio of the rotor in the loop along `x` or `y`; None if no mode oscillates."""
        from amb_core.step_response import SecondOrder

        poles, vectors = np.linalg.eig(self.closed_loop.A)
        rates = _rates(poles, self.closed_loop.dt)
        swinging = np.flatnonzero((rates.imag > 0.0) & (poles.imag != 0.0))
        # The amplifiers are far faster than the rotor, so its two modes are the slowest that oscillate.
        slowest = swinging[np.argsort(np.abs(rates[swinging]))][:2]
        shares = np.abs(vectors[np.ix_([self.closed_loop.find_state(name) for name in AXES], slowest)])
        if len(slowest) == 0:
            return None
        rate = rates[slowest[np.argmax(shares[AXES.index(axis)] / shares.sum(axis=0))]]
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
        Gives the parameters; its state is neither used nor changed. `switching` makes no difference here.
    controller : ControllerParameters, optional
        By default the paper's.
    position : ndarray, shape (2,), optional
        Rotor position about which to linearise (m). By default where the controller holds the rotor, sag included.

    Raises
    ------
    PlantError
        If there is no such equilibrium within the limits of currents and duty cycles, or the sample rates of plant and
        controller differ.
    """
    controller = controller or ControllerParameters()
    if abs(controller.sample_rate * plant.sample_time - 1.0) > 1e-9:
        raise PlantError(
            f"the controller runs at {controller.sample_rate:g} Hz, the plant is sampled at "
            f"{1.0 / plant.sample_time:g} Hz; the two rates must be equal"
        )
    point = point_held_by(controller, plant) if position is None else point_at(position, plant)
    continuous = linear_plant(plant, point)
    discrete = continuous.sample(plant.sample_time, method="zoh", name="plant")
    return Linearization(point, controller, continuous, discrete, *close_loop(discrete, controller))


def linear_plant(plant: Plant, point: OperatingPoint) -> control.StateSpace:
    """The plant from i_x, i_y (A) to x, y (m) about an operating point, continuous, states named."""
    import control  # takes a second to import, which programs that do not need it should not wait

    kept, embedding = _independent_states(plant)
    steps = _RELATIVE_STEP * np.concatenate([_scales(plant)[kept], np.ones(2)])
    columns = []
    for deviation in np.diag(steps):
        change, control_current = embedding @ deviation[:-2], deviation[-2:]
        ahead, behind = (
            averaged_rates(point.state + side * change, point.current_reference + side * control_current, plant)
            for side in (1.0, -1.0)
        )
        columns.append((ahead - behind)[kept] / (2.0 * deviation.sum()))
    a, b = np.split(np.column_stack(columns), [len(kept)], axis=1)
    return control.StateSpace(
        a,
        b,
        embedding[POSITION],
        np.zeros((2, 2)),
        states=[STATE_NAMES[n] for n in kept],
        inputs=["i_x", "i_y"],
        outputs=list(AXES),
        name="plant",
    )


def close_loop(
    plant: control.StateSpace, controller: ControllerParameters
) -> tuple[control.StateSpace, control.StateSpace]:
    """Loop of a discrete plant and the PD controller, its limits aside.

    With a and w the pole and the weight of the derivative filter, the derivative d of u is d[k] = w (a - 1) s[k] +
    w u[k], s[k+1] = a s[k] + u[k].

    Parameters
    ----------
    plant : control.StateSpace
        From i_x, i_y (A) to x, y (m), without direct feed-through.
    controller : ControllerParameters
        Gains and filter; `derivative_on` decides whether u is r - y or -y.

    Returns
    -------
    closed_loop : control.StateSpace
        From r_x, r_y to x, y (m).
    sensitivity : control.StateSpace
        From a disturbance w_x, w_y of the measurement to the measured x, y (m).
    """
    import control

    proportional, derivative, pole, weight, on_error, _ = pack_gains(controller)
    order = plant.nstates
    direct = proportional + derivative * weight  # from -y to i
    a = np.zeros((order + 2, order + 2))
    a[:order, :order] = plant.A - direct * plant.B @ plant.C
    a[:order, order:] = derivative * weight * (pole - 1.0) * plant.B
    a[order:, :order] = -plant.C
    a[order:, order:] = pole * np.eye(2)
    output = np.hstack([plant.C, np.zeros((2, 2))])
    states = [*plant.state_labels, "derivative_x", "derivative_y"]
    from_reference = np.vstack([(proportional + on_error * derivative * weight) * plant.B, on_error * np.eye(2)])
    from_measurement = np.vstack([-direct * plant.B, -np.eye(2)])
    closed_loop = control.StateSpace(
        a, from_reference, output, np.zeros((2, 2)), plant.dt,
        states=states, inputs=["r_x", "r_y"], outputs=list(AXES), name="closed_loop",
    )  # fmt: skip
    sensitivity = control.StateSpace(
        a, from_measurement, output, np.eye(2), plant.dt,
        states=states, inputs=["w_x", "w_y"], outputs=list(AXES), name="sensitivity",
    )  # fmt: skip
    return closed_loop, sensitivity


def flux_embedding(plant: Plant) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Independent pole fluxes and what they make of all of them.

    Returns
    -------
    kept : ndarray, shape (n,)
        Poles with independent fluxes: all but the last of each circuit.
    embedding : ndarray, shape (8, n)
        Maps their fluxes to all pole fluxes, those left out being minus the sum of the others of their circuit.
    """
    circuits = flux_constraints(plant.parameters.magnetic_circuit.coupling)
    left_out = POLES - 1 - np.argmax(circuits[::-1], axis=0)
    kept = np.setdiff1d(np.arange(POLES), left_out)
    embedding = np.eye(POLES)[:, kept]
    embedding[left_out] = -circuits[kept].T
    return kept, embedding


def _rates(poles: NDArray[np.complex128], sample_time: float) -> NDArray[np.complex128]:
    """ln(z) / T, with -inf for z = 0."""
    with np.errstate(divide="ignore"):
        return np.log(np.abs(poles)) / sample_time + 1j * np.angle(poles) / sample_time


def _independent_states(plant: Plant) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Indices of the states that no constraint binds, and the map from these states to all."""
    poles, fluxes = flux_embedding(plant)
    # Without integral gain the integral parts stay what they are: no states of the linear model.
    last = STATE_SIZE if plant.parameters.amplifier.integral_gain > 0.0 else INTEGRAL.start
    others = np.arange(POLES, last)
    embedding = np.zeros((STATE_SIZE, len(poles) + len(others)))
    embedding[FLUX, : len(poles)] = fluxes
    embedding[others, len(poles) + np.arange(len(others))] = 1.0
    return np.concatenate([poles, others]), embedding


def _scales(plant: Plant) -> NDArray[np.float64]:
    circuit = plant.parameters.magnetic_circuit
    scales = np.ones(STATE_SIZE)
    scales[FLUX] = circuit.turns_per_pole / (plant.network.gap_reluctance * circuit.air_gap)
    scales[POSITION] = circuit.air_gap
    return scales
