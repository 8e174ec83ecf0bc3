"""The identified model in closed loop with the known controller: simulation and poles.

An unstable plant cannot be validated by an open-loop simulation: any error grows without bound. In closed loop with the
controller of the experiment, the model must reproduce the response to the reference alone.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.identification.control_law import Law, LinearLaw, Start, advance_law, law_of, recall, state_of
from amb_core.identification.estimate.small_matrices import add_product, set_product
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_control import LinearControllerParameters, pd_as_linear
from amb_core.loop.records import LoopRecord
from amb_core.model.state_space import StateSpaceModel

_MEMORY = 8_192  # samples after which noise has left the loop
DIVERGED = 1e-2  # m, larger than the air gap of any bearing considered here


class DivergenceError(IdentificationError):
    """The simulated closed loop of model and controller diverges."""


def simulate_closed_loop(
    model: StateSpaceModel,
    controller: KnownController,
    reference: NDArray[np.float64],
    first_step: int = 0,
    start: Start | NDArray[np.float64] | None = None,
) -> LoopRecord:
    """Simulate the model under the control law of the experiment, current limit and offsets included.

    Parameters
    ----------
    model : StateSpaceModel
        Model without direct feedthrough; starts in its initial state.
    controller : KnownController
        The PD controller or a linear one.
    reference : ndarray, shape (steps, axes)
        Reference position (m).
    first_step : int
        Controller step of the first sample.
    start : Start or ndarray, shape (axes,), optional
        The controller's past, for data that start within a run (see `start_of`), or no more of it than its control
        current references at the first sample (A). By default the controller starts with the first sample.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    DivergenceError
        If the position leaves the range of 10 mm; the message gives the step.
    """
    axes = loop_axes(model, controller)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    position, current = np.zeros_like(reference), np.zeros_like(reference)
    law = law_of(controller, axes)
    state = state_of(law)
    if start is not None and len(reference):
        output = model.c @ model.initial_state + model.output_offset
        recall(law, state, output, reference[0], start if isinstance(start, Start) else Start(start))
    stopped = _simulate(
        model.a, model.b, model.c, model.input_offset, model.output_offset, model.initial_state.copy(),
        np.empty(model.order), law, state, reference, position, current,
    )  # fmt: skip
    if stopped >= 0:
        raise DivergenceError(
            f"the closed loop of model and controller diverges: position beyond {DIVERGED * 1e3:g} mm "
            f"at step {first_step + stopped}"
        )
    return LoopRecord(first_step, model.sample_time, reference, position, current)


def closed_loop_poles(model: StateSpaceModel, controller: KnownController) -> NDArray[np.complex128]:
    """Poles in the z plane of the model under the control law without its limit, largest first.

    Shape (n + c,): the states are those of the model and of the controller. Those of the PD law are, per axis, the
    filtered derivative and the previous position of the backward difference.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    """
    law = law_of(controller, loop_axes(model, controller))
    loop = _linear_loop(model, law) if isinstance(law, LinearLaw) else _pd_loop(model, law.gains)
    poles = np.linalg.eigvals(loop).astype(np.complex128)
    return poles[np.argsort(-np.abs(poles), kind="stable")]


def noise_in_loop(
    model: StateSpaceModel, controller: KnownController, covariance: NDArray[np.float64], steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What innovations of a covariance add to the positions in the loop without its limit.

    Returns
    -------
    variance, deviation : ndarray, shape (axes,)
        Variance of each position (m^2), and the standard deviation of its mean square over so many steps.

    Raises
    ------
    IdentificationError
        If model and controller do not fit together, or the loop is not stable.
    """
    law = _as_linear(model, controller)
    from_output, direct = law.from_output
    loop = _linear_loop(model, law)
    if not np.abs(np.linalg.eigvals(loop)).max() < 1.0:
        raise IdentificationError("the closed loop of model and controller is not stable")
    drive = np.vstack([model.k + model.b @ direct, from_output])
    shown = np.hstack([model.c, np.zeros((len(model.c), len(law.a)))])
    responses = np.empty((_MEMORY, len(shown), len(shown)))
    responses[0] = np.eye(len(shown))
    for step in range(1, _MEMORY):
        responses[step] = shown @ drive
        drive = loop @ drive
    spectra = np.fft.fft(responses, axis=0)
    power = np.einsum("fij,jk,fik->fi", spectra, covariance, spectra.conj()).real
    # Parseval: the variance is the mean of the spectrum, and the sum of all squared autocovariances that of its square,
    # of which the mean square of normal noise over N steps has 2 / N times as variance.
    return power.mean(axis=0), np.sqrt(2.0 * np.mean(power**2, axis=0) / steps)


def complementary_sensitivity(
    model: StateSpaceModel, controller: KnownController, frequency: float
) -> NDArray[np.complex128]:
    """T = -G K (I - G K)^-1 of the loop with u = K y, its limit aside, at a frequency (Hz); shape (axes, axes)."""
    law = _as_linear(model, controller)
    from_output, direct = law.from_output
    at = np.exp(2j * np.pi * frequency * model.sample_time)
    k = law.c @ np.linalg.solve(at * np.eye(len(law.a)) - law.a, from_output) + direct
    loop = (model.c @ np.linalg.solve(at * np.eye(model.order) - model.a, model.b)) @ k
    return np.asarray(-loop @ np.linalg.inv(np.eye(len(loop)) - loop))


def _as_linear(model: StateSpaceModel, controller: KnownController) -> LinearLaw:
    """The law without its limit; the PD law in state-space form."""
    axes = loop_axes(model, controller)
    if isinstance(controller, ControllerParameters):
        limit = LinearControllerParameters(current_limit=controller.current_limit)
        controller = LinearControl(pd_as_linear(controller, axes), limit)
    law = law_of(controller, axes)
    assert isinstance(law, LinearLaw)
    return law


def _linear_loop(model: StateSpaceModel, law: LinearLaw) -> NDArray[np.float64]:
    """Matrix of the loop with a linear law: x+ = (A + B D_y C) x + B C_c w, w+ = B_y C x + A_c w."""
    from_output, direct = law.from_output
    plant = np.hstack([model.a + model.b @ direct @ model.c, model.b @ law.c])
    return np.vstack([plant, np.hstack([from_output @ model.c, law.a])])


def _pd_loop(model: StateSpaceModel, gains: NDArray[np.float64]) -> NDArray[np.float64]:
    proportional, derivative, keep, weight = (np.diag(gain) for gain in gains[:, :4].T)
    n, axes = model.order, len(gains)
    # Controller: d+ = keep d + weight (h - y), h+ = y, u = -proportional y + derivative d+, with h the previous y.
    derived = np.hstack([-weight @ model.c, keep, weight])
    output = np.hstack([model.c, np.zeros((axes, 2 * axes))])
    feedback = derivative @ derived - proportional @ output
    plant = np.hstack([model.a, np.zeros((n, 2 * axes))]) + model.b @ feedback
    return np.vstack([plant, derived, output])


def loop_axes(model: StateSpaceModel, controller: KnownController) -> int:
    """Number of axes of the loop."""
    inputs, outputs = model.b.shape[1], model.c.shape[0]
    if inputs != outputs:
        raise IdentificationError(
            f"the model has {inputs} inputs and {outputs} outputs; a controller of axes needs as many of both"
        )
    if np.any(model.d):
        raise IdentificationError("the model must have no direct feedthrough (D = 0) to be put in closed loop")
    if abs(model.sample_time * controller.sample_rate - 1.0) > 1e-9:
        raise IdentificationError(
            f"model and controller must have one sample time: {model.sample_time:g} s "
            f"and {1.0 / controller.sample_rate:g} s"
        )
    return inputs


@numba.njit(cache=True)
def _simulate(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    input_offset: NDArray[np.float64],
    output_offset: NDArray[np.float64],
    state: NDArray[np.float64],
    advanced: NDArray[np.float64],
    law: Law,
    controller_state: NDArray[np.float64],
    reference: NDArray[np.float64],
    position: NDArray[np.float64],
    current: NDArray[np.float64],
) -> int:
    """Fill in `position` and `current` from the state at the first step; returns the step of divergence, or -1.

    `advanced` is work space of the shape of `state`.
    """
    axes = len(output_offset)
    deviation = np.empty(axes)
    for step in range(len(reference)):
        set_product(c, state, position[step])
        for axis in range(axes):
            position[step, axis] += output_offset[axis]
            if not abs(position[step, axis]) < DIVERGED:  # catches NaN too
                return step
        advance_law(law, controller_state, position[step], reference[step], current[step])
        for axis in range(axes):
            deviation[axis] = current[step, axis] - input_offset[axis]
        set_product(a, state, advanced)
        add_product(b, deviation, advanced)
        state, advanced = advanced, state
    return -1
