"""Simulation focus: a model whose closed loop with the known controller answers to the reference as the real one does.

PEM makes the one-step prediction errors small; where the order is too low for the plant, or the plant not linear, the
model with the best predictions is not the one with the best simulation. Here the simulated closed loop, driven by the
reference alone, is fitted to the measured positions. An open-loop simulation of the unstable plant is never made.

Gauss-Newton with Levenberg-Marquardt damping over data-driven local coordinates of (A, B, C), which are renewed at
every step, and over the initial state of each experiment. K, which the simulation does not see, is estimated last, so
that the model stays in innovations form.

Sources: as for `local_coordinates` and `levenberg_marquardt`; L. Ljung, System Identification, 2nd ed., Prentice Hall,
1999, section 7.3 (output errors).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from threadpoolctl import threadpool_limits

from amb_core.control import ControllerParameters
from amb_core.errors import IdentificationError
from amb_core.identification.closed_loop import DivergenceError, closed_loop_poles, simulate_closed_loop
from amb_core.identification.data import IdentificationData
from amb_core.identification.levenberg_marquardt import minimise
from amb_core.identification.local_coordinates import local_directions
from amb_core.identification.model import StateSpaceModel
from amb_core.identification.progress import Cancelled, Progress, Watch
from amb_core.identification.simulation_focus_gain import fit_kalman_gain
from amb_core.identification.simulation_focus_sensitivity import Directions, sensitivity_factor
from amb_core.records import LoopRecord

_STAGE = "simulation focus"
_MOST_ITERATIONS = 30
_LARGEST_RADIUS = 1.0 - 1e-6  # of the closed loop's modes

Arrays = NDArray[np.float64]
Weighting = Literal["variance", "noise"]


def focus_simulation(
    model: StateSpaceModel,
    data: IdentificationData,
    controller: ControllerParameters,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    *,
    weighting: Weighting = "variance",
    free_offset: bool = False,
    most_iterations: int = _MOST_ITERATIONS,
) -> StateSpaceModel:
    """Improve a model until its closed loop follows the measured positions as well as it can.

    Parameters
    ----------
    model : StateSpaceModel
        Where to start; its closed loop must be stable. Its offsets are those of the signals as measured, detrended or
        not.
    data : IdentificationData
        Currents (A), positions (m) and references (m); experiments without reference are left out.
    controller : ControllerParameters
        The controller of the experiments.
    progress : callable, optional
        Called at every iteration, with the mean square of the weighted errors as cost.
    cancelled : callable, optional
        Asked at every iteration whether to give up.
    weighting : {"variance", "noise"}
        Errors are weighted by the inverse of each position's variance, so that the fits in percent are what is
        improved, or by that of the covariance of the model's innovations.
    free_offset : bool
        Whether the output offset, the mean of the data in models from `pem`, may change as well. Together with the
        state it stands for both offsets.
    most_iterations : int
        Steps tried, taken or not.

    Returns
    -------
    StateSpaceModel
        Never worse than `model`, with a stable closed loop and a stable predictor. Its initial state is that of the
        first experiment that has a reference.

    Raises
    ------
    IdentificationError
        If no experiment has a reference, the data are too few or do not suit, the start's closed loop is not stable, or
        the search is cancelled.
    """
    watch = Watch(progress, cancelled)
    problem = _Problem.of(model, data, controller, weighting, free_offset)

    def tell(iteration: int, squares: float) -> None:
        watch.tell(_STAGE, iteration, most_iterations, squares / problem.samples)

    # The matrices are small: more BLAS threads only cost time, and take cores from the control loop.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            start = problem.start(model)
            found = minimise(start, problem.squares, problem.linearise, problem.move, tell, most_iterations)
            focused = fit_kalman_gain(found.model, problem.records, found.initial_states)
        except (linalg.LinAlgError, ValueError) as failure:
            reason = " ".join(str(failure).split())
            raise IdentificationError(f"no simulation focus for the model of order {model.order}: {reason}") from None
    return replace(
        focused,
        initial_state=found.initial_states[0],
        method=f"{model.method}, simulation focus",
        samples=problem.samples,
        fit=np.empty(0),
    )


@dataclass(frozen=True)
class _Loop:
    """A model, the state at the first sample of each experiment, and the directions in which the model may change."""

    model: StateSpaceModel
    initial_states: Arrays
    directions: Directions

    def experiment(self, index: int) -> StateSpaceModel:
        """The model with the initial state of an experiment."""
        return replace(self.model, initial_state=self.initial_states[index])


@dataclass(frozen=True)
class _Problem:
    """Simulation errors of the closed loop, of which the sum of weighted squares is to be as small as possible."""

    controller: ControllerParameters
    records: list[LoopRecord]
    weight: Arrays
    free_offset: bool

    @classmethod
    def of(
        cls,
        model: StateSpaceModel,
        data: IdentificationData,
        controller: ControllerParameters,
        weighting: Weighting,
        free_offset: bool,
    ) -> _Problem:
        """The problem that data and controller pose, checked."""
        known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
        if not known:
            raise IdentificationError("simulation focus needs the reference, which these data lack")
        records = [data.record(index) for index in known]
        positions = np.vstack([record.position for record in records])
        signals = np.hstack([np.vstack([np.hstack([r.current, r.reference]) for r in records]), positions])
        if not np.all(np.isfinite(signals)):
            raise IdentificationError("simulation focus needs finite data; leave invalid samples out first")
        unknowns = model.order * (len(records) + 4) + 2 * free_offset
        if positions.size <= unknowns:
            raise IdentificationError(
                f"{len(positions)} samples are too few for the {unknowns} unknowns of order {model.order}"
            )
        if weighting == "noise":
            covariance = model.innovation_covariance
        elif weighting == "variance":
            covariance = np.diag(positions.var(axis=0))
        else:
            raise IdentificationError(f"weighting by {weighting!r} is not allowed; allowed: variance, noise")
        if not np.all(np.linalg.eigvalsh(covariance) > 0.0):
            raise IdentificationError(f"weighting by the {weighting} needs one that is not singular")
        return cls(controller, records, np.linalg.inv(linalg.cholesky(covariance, lower=True)), free_offset)

    @property
    def samples(self) -> int:
        """Number of samples of all experiments."""
        return sum(record.steps for record in self.records)

    def start(self, model: StateSpaceModel) -> _Loop:
        """The loop to start from; experiments after the first start in the operating point."""
        states = np.zeros((len(self.records), model.order))
        states[0] = model.initial_state
        loop = self._loop(model, states)
        if not self._stable(model) or not np.isfinite(self.squares(loop)):
            raise IdentificationError(
                f"the closed loop of the start of order {model.order} and the controller is not stable; "
                "take another order"
            )
        return loop

    def squares(self, loop: _Loop) -> float:
        """Sum of the squared weighted errors, infinite where the simulation diverges."""
        total = 0.0
        for index, record in enumerate(self.records):
            try:
                simulated = simulate_closed_loop(
                    loop.experiment(index), self.controller, record.reference, record.first_step, _first_current(record)
                )
            except DivergenceError:
                return np.inf
            total += float(np.sum(((record.position - simulated.position) @ self.weight.T) ** 2))
        return total

    def linearise(self, loop: _Loop) -> tuple[Arrays, Arrays]:
        """Derivatives along the directions, then by the initial states, and errors, in the coordinates of a factor."""
        n, count = loop.model.order, loop.directions.count
        blocks = []
        for index, record in enumerate(self.records):
            factor = sensitivity_factor(
                loop.experiment(index), self.controller, record, _first_current(record), loop.directions, self.weight
            )
            block = np.zeros((len(factor), count + n * len(self.records) + 1))
            block[:, count + n * index : count + n * (index + 1)] = factor[:, :n]
            block[:, :count], block[:, -1] = factor[:, n:-1], factor[:, -1]
            blocks.append(block)
        rows = np.vstack(blocks)
        return rows[:, :-1], rows[:, -1]

    def move(self, loop: _Loop, step: Arrays) -> _Loop | None:
        """The loop after a step in the coordinates of `linearise`; None where it is not stable."""
        directions, model = loop.directions, loop.model
        along, states = np.split(step, [directions.count])
        offset, inside = np.split(along, [directions.of_offset.shape[1]])
        moved = replace(
            model,
            a=model.a + directions.of_a @ inside,
            b=model.b + directions.of_b @ inside,
            c=model.c + directions.of_c @ inside,
            output_offset=model.output_offset + directions.of_offset @ offset,
        )
        if not self._stable(moved):
            return None
        return self._loop(moved, loop.initial_states + states.reshape(loop.initial_states.shape))

    def _loop(self, model: StateSpaceModel, initial_states: Arrays) -> _Loop:
        inputs = np.vstack([record.current for record in self.records]).std(axis=0)
        outputs = np.vstack([record.position for record in self.records]).std(axis=0)
        of_a, of_b, of_c = local_directions(model.a, model.b * inputs, model.c / outputs[:, np.newaxis])
        of_b, of_c = of_b / inputs[:, np.newaxis], of_c * outputs[:, np.newaxis, np.newaxis]
        of_offset = np.diag(outputs)[:, : 2 * self.free_offset]
        return _Loop(model, initial_states, Directions(of_a, of_b, of_c, of_offset))

    def _stable(self, model: StateSpaceModel) -> bool:
        return bool(np.abs(closed_loop_poles(model, self.controller)[0]) < _LARGEST_RADIUS)


def _first_current(record: LoopRecord) -> Arrays | None:
    """The answer in which the controller's past shows, of data that do not start with the run."""
    return record.current[0] if record.first_step > 0 else None
