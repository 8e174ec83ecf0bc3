"""The control loop without ROS: the samples that the lock-step graph must reproduce bit for bit.

Step k: the controller responds to the position of step k; the plant holds this current over [t_k, t_k+1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ExcitationError, ParameterError
from amb_core.ground.given_values import numbers, require_callable, require_kind, whole_number
from amb_core.ground.progress import Progress
from amb_core.loop.control import ControllerParameters, PdController, require_one_rate
from amb_core.loop.law import ControlLaw
from amb_core.loop.machine import first_bearing
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant

MOST_STEPS = 10**9
"""Of a run: its samples would fill 50 GB."""


def simulate(
    plant: Plant,
    controller: ControlLaw,
    steps: int,
    excitation: NDArray[np.float64] | None = None,
    excitation_step: int = 0,
    progress: Progress | None = None,
) -> LoopRecord:
    """Reset plant and controller and run the closed loop from step 0.

    Parameters
    ----------
    plant, controller : Plant, ControlLaw
        Both are reset first.
    steps : int
        Number of controller samples.
    excitation : ndarray, shape (n, axes), optional
        Added to the nominal reference position (m). None for the nominal reference alone.
    excitation_step : int, optional
        Step of the first excitation sample.
    progress : callable, optional
        Called every 1000 steps, see `amb_core.ground.progress.Progress`. None for no calls.

    Returns
    -------
    LoopRecord
        The samples; fewer than `steps` if the rotor delevitated (then `plant.delevitated`).

    Raises
    ------
    ParameterError
        If plant or controller are something else, their sample rates or axes differ, or `steps` is negative.
    ExcitationError
        If the excitation has another shape, holds a value that is not finite, or begins outside the run.
    """
    _require_plant(plant)
    allowed = "a control law, such as PdController(ControllerParameters()) or a LinearController"
    require_kind("controller", controller, ControlLaw, allowed, ParameterError)
    require_one_rate(controller.sample_rate, 1.0 / plant.sample_time)
    if controller.axes != len(plant.machine.axes):
        raise ParameterError(
            f"the controller has {controller.axes} axes, the machine {len(plant.machine.axes)}: "
            f"{', '.join(plant.machine.axis_names)}"
        )
    require_callable("progress", progress, ParameterError)
    steps = whole_number("steps", steps, ParameterError)
    if not 0 <= steps <= MOST_STEPS:
        raise ParameterError(f"steps = {steps} is not allowed; allowed: 0 or more, up to {MOST_STEPS}")
    excitation_step = whole_number("excitation_step", excitation_step, ExcitationError)
    if excitation is not None:
        excitation = numbers("excitation", excitation, ExcitationError)
        _check_excitation(excitation, excitation_step, steps, plant.machine.axis_names)
    plant.reset()
    controller.reset()
    reference = np.tile(controller.nominal_reference, (steps, 1))
    if excitation is not None:
        last = min(steps, excitation_step + len(excitation))
        reference[excitation_step:last] += excitation[: max(last - excitation_step, 0)]
    position, current = np.empty_like(reference), np.empty_like(reference)
    now = plant.position
    done = steps
    for step in range(steps):
        answer = controller.update(now, reference[step])
        position[step] = now
        current[step] = answer
        now = plant.advance(answer)
        if plant.delevitated:
            done = step + 1
            break
        if progress is not None and (step + 1) % 1000 == 0:
            progress("simulation", step + 1, steps)
    signals = reference[:done], position[:done], current[:done]
    return LoopRecord(0, plant.sample_time, *signals, plant.machine.axis_names)


def simulate_first_bearing(
    plant: Plant,
    parameters: ControllerParameters,
    steps: int,
    excitation: NDArray[np.float64],
    excitation_step: int = 0,
    progress: Progress | None = None,
) -> LoopRecord:
    """`simulate` with the excitation on the first radial bearing of a machine, and the record of that bearing.

    Parameters
    ----------
    plant : Plant
        The plant; reset first.
    parameters : ControllerParameters
        Of the controller of all axes.
    steps : int
        Number of controller samples.
    excitation : ndarray, shape (n, 2)
        Added to the nominal reference position x, y (m) of that bearing.
    excitation_step : int, optional
        Step of the first excitation sample.
    progress : callable, optional
        Called with the number of steps done, every 1000 steps; None for no calls.

    Returns
    -------
    LoopRecord
        The samples of the first bearing; fewer than `steps` if the rotor delevitated.

    Raises
    ------
    ParameterError, ExcitationError
        As `simulate`; the excitation has two columns.
    """
    _require_plant(plant)
    axes = len(plant.machine.axes)
    excitation = numbers("excitation", excitation, ExcitationError)
    if excitation.shape[1:] != (2,):
        raise ExcitationError(f"the excitation has shape {excitation.shape}; allowed: (n, 2), axes x and y")
    every_axis = np.zeros((len(excitation), axes))
    every_axis[:, :2] = excitation
    controller = PdController(parameters, axes)
    return first_bearing(simulate(plant, controller, steps, every_axis, excitation_step, progress))


def _require_plant(plant: object) -> None:
    require_kind("plant", plant, Plant, "a Plant, such as Plant(PlantParameters())", ParameterError)


def _check_excitation(excitation: NDArray[np.float64], first: int, steps: int, axes: tuple[str, ...]) -> None:
    if np.ndim(excitation) != 2 or np.shape(excitation)[1] != len(axes):
        raise ExcitationError(
            f"the excitation has shape {np.shape(excitation)}; allowed: (n, {len(axes)}), axes {', '.join(axes)}, "
            "zeros on an axis at rest"
        )
    if not np.isfinite(excitation).all():
        step, axis = np.argwhere(~np.isfinite(excitation))[0]
        raise ExcitationError(f"the excitation on {axes[axis]} is {excitation[step, axis]} at its sample {step}")
    if not 0 <= first <= steps:
        raise ExcitationError(f"excitation_step = {first} is outside the run of {steps} steps; allowed: 0 to {steps}")
