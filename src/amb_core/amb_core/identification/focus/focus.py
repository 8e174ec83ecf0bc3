"""Simulation focus: a model whose closed loop with the known controller responds to the reference like the real one.

PEM minimises the one-step prediction errors. If the order is too low for the plant, or the plant is not linear, the
model with the best predictions is not the one with the best simulation. Here the simulated closed loop, driven by the
reference alone, is fitted to the measured positions. The unstable plant is never simulated in open loop.

Gauss-Newton with Levenberg-Marquardt damping over data-driven local coordinates of (A, B, C), which are renewed at
every step, and over the initial state of each experiment. K, which does not affect the simulation, is estimated
last, so the model stays in innovations form.

Sources: as for `local_coordinates` and `levenberg_marquardt`; L. Ljung, System Identification, 2nd ed., Prentice Hall,
1999, sections 7.3 (output errors) and 8.4 (what a model of too low an order converges to).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.dataset import require_data
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind
from amb_core.identification.estimate.levenberg_marquardt import minimise
from amb_core.identification.focus.gain import fit_kalman_gain
from amb_core.identification.focus.problem import SimulationProblem
from amb_core.identification.progress import FOCUSED, Cancelled, Progress, SearchEnd, Watch
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import small_matrices
from amb_core.loop.known_controller import KnownController

MOST_ITERATIONS = 20
_LEAST_GAIN = 1e-3  # relative decrease of the squared errors at which the search ends: 0.05 % of what a fit lacks


def focus_simulation(
    model: StateSpaceModel,
    data: IdentificationData,
    controller: KnownController,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    *,
    free_offset: bool = False,
    most_iterations: int = MOST_ITERATIONS,
) -> StateSpaceModel:
    """Improve a model until its closed loop follows the measured positions as well as possible.

    Parameters
    ----------
    model : StateSpaceModel
        Where to start; its predictor and its closed loop must be stable. Its offsets are those of the data before
        detrending.
    data : IdentificationData
        Currents (A), positions (m) and references (m); experiments without reference are left out.
    controller : KnownController
        The controller of the experiments, current limit included.
    progress : callable, optional
        Called at every iteration, with the mean square of the errors, relative to the variance of each position, as
        cost. None for no calls.
    cancelled : callable, optional
        Called at every iteration; returns whether the identification has been cancelled. None if it cannot be
        cancelled.
    free_offset : bool, optional
        Whether the output offset, which is the mean of the data in a model from `pem`, may change as well. The input
        offset needs no change of its own: the state can represent it.
    most_iterations : int, optional
        Steps tried, taken or not.

    Returns
    -------
    StateSpaceModel
        Never with larger errors than `model`; closed loop and predictor are stable. The initial state is that of the
        first experiment that has a reference.

    Raises
    ------
    IdentificationError
        If no experiment has a reference, the data are too few or not finite, the start is not stable, or the
        identification is cancelled.
    """
    require_kind("model", model, StateSpaceModel, "a StateSpaceModel", IdentificationError)
    require_data(data)
    watch = Watch(progress, cancelled)
    with small_matrices(f"no simulation focus for the model of order {model.order}"):
        problem = SimulationProblem(model, data, controller, free_offset)

        def tell(iteration: int, squares: float) -> None:
            watch.tell("simulation focus", iteration, most_iterations, squares / problem.samples)

        search = minimise(
            problem.start, problem.squares, problem.linearise, problem.move, tell, most_iterations, _LEAST_GAIN
        )
        loop = search.point
        focused = fit_kalman_gain(loop.model, *problem.deviations(loop), loop.initial_states)
    return replace(
        focused,
        initial_state=loop.initial_states[0],
        method=f"{model.method}, {FOCUSED}",
        samples=problem.samples,
        fit=np.empty(0),
        search=SearchEnd(search.iterations, search.left, search.left < _LEAST_GAIN).values,
        undecided=(),
    )
