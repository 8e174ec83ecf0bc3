"""The errors of the simulated closed loop as a function of the model, for `levenberg_marquardt.minimise`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.closed_loop import DivergenceError, closed_loop_poles, simulate_closed_loop
from amb_core.identification.controller_state import start_of
from amb_core.identification.estimate.local_coordinates import balanced_predictor, local_directions
from amb_core.identification.experiment_simulation import in_experiment
from amb_core.identification.focus.sensitivity import LoopDirections, sensitivity_factor
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import LARGEST_RADIUS
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class Loop:
    """A point of the search.

    Attributes
    ----------
    model : StateSpaceModel
        The model.
    initial_states : ndarray, shape (experiments, n)
        Its state at the first sample of each experiment.
    directions : LoopDirections
        In which the model may change.
    """

    model: StateSpaceModel
    initial_states: Arrays
    directions: LoopDirections


class SimulationProblem:
    """The sum of the squared errors of the simulated positions, and how it changes with the model.

    Errors are relative to the standard deviation of each position, so minimising them improves the fits in percent.

    Parameters
    ----------
    model : StateSpaceModel
        Where to start.
    data, controller, free_offset
        As in `focus_simulation`.

    Raises
    ------
    IdentificationError
        If model, data and controller do not suit each other.
    """

    def __init__(
        self,
        model: StateSpaceModel,
        data: IdentificationData,
        controller: KnownController,
        free_offset: bool,
    ) -> None:
        known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
        if not known:
            raise IdentificationError("simulation focus needs the reference, which these data lack")
        self._controller = controller
        self._records = [data.record(index) for index in known]
        self._starts = [start_of(controller, record) for record in self._records]
        inputs, outputs = (np.vstack(signals) for signals in zip(*map(_signals, self._records), strict=True))
        self.samples = len(outputs)
        axes = outputs.shape[1]
        unknowns = model.order * (len(known) + 2 * axes) + axes * free_offset
        if outputs.size <= unknowns:
            raise IdentificationError(
                f"{self.samples} samples are too few for the {unknowns} unknowns of order {model.order}"
            )
        self._input_scale, self._output_scale = inputs.std(axis=0), outputs.std(axis=0)
        if not np.all(self._output_scale > 0.0):
            raise IdentificationError("simulation focus needs every position to move; one is constant")
        self._free = axes if free_offset else 0
        balanced = balanced_predictor(model, self._input_scale)
        own = [in_experiment(balanced, data, index) for index in known]
        # Operating points of the experiments, which may have been detrended separately, relative to the model's.
        self._input_shifts = [one.input_offset - model.input_offset for one in own]
        self._output_shifts = [one.output_offset - model.output_offset for one in own]
        self.start = self._loop(balanced, np.array([one.initial_state for one in own]))
        if not self._stable(model) or not np.isfinite(self.squares(self.start)):
            raise IdentificationError(
                f"the closed loop of the controller and the start of order {model.order} is not stable; "
                "simulation focus needs another start"
            )

    def squares(self, loop: Loop) -> float:
        """Sum of the squared relative errors, infinite where a simulation diverges."""
        total = 0.0
        for index, record in enumerate(self._records):
            try:
                simulated = simulate_closed_loop(
                    self.model(loop, index), self._controller, record.reference, record.first_step, self._starts[index]
                )
            except DivergenceError:
                return np.inf
            total += float(np.sum(((record.position - simulated.position) / self._output_scale) ** 2))
        return total

    def linearise(self, loop: Loop) -> tuple[Arrays, Arrays]:
        """Derivatives along the directions, then by the initial states, and errors, in coordinates of triangles."""
        n, count = loop.model.order, loop.directions.count
        blocks = []
        for index, record in enumerate(self._records):
            factor = sensitivity_factor(
                self.model(loop, index),
                self._controller,
                record,
                self._starts[index],
                loop.directions,
                self._output_scale,
            )
            block = np.zeros((len(factor), count + n * len(self._records) + 1))
            block[:, :count], block[:, -1] = factor[:, n:-1], factor[:, -1]
            block[:, count + n * index : count + n * (index + 1)] = factor[:, :n]
            blocks.append(block)
        rows = np.vstack(blocks)
        return rows[:, :-1], rows[:, -1]

    def move(self, loop: Loop, step: Arrays) -> Loop | None:
        """The loop after a step in the coordinates of `linearise`; None if it is not stable."""
        directions, model = loop.directions, loop.model
        offset, change, states = np.split(step, [self._free, directions.count])
        moved = replace(
            model,
            a=model.a + directions.of_a @ change,
            b=model.b + directions.of_b @ change,
            c=model.c + directions.of_c @ change,
            output_offset=model.output_offset + directions.of_offset @ offset,
        )
        if not self._stable(moved):
            return None
        return self._loop(moved, loop.initial_states + states.reshape(loop.initial_states.shape))

    def model(self, loop: Loop, index: int) -> StateSpaceModel:
        """The model of a loop about the operating point and in the initial state of an experiment."""
        return replace(
            loop.model,
            input_offset=loop.model.input_offset + self._input_shifts[index],
            output_offset=loop.model.output_offset + self._output_shifts[index],
            initial_state=loop.initial_states[index],
        )

    def deviations(self, loop: Loop) -> tuple[list[Arrays], list[Arrays]]:
        """Inputs (A) and outputs (m) of each experiment without the offsets of the model."""
        models = [self.model(loop, index) for index in range(len(self._records))]
        pairs = list(zip(self._records, models, strict=True))
        return (
            [record.current - model.input_offset for record, model in pairs],
            [record.position - model.output_offset for record, model in pairs],
        )

    def _loop(self, model: StateSpaceModel, initial_states: Arrays) -> Loop:
        inputs, outputs = self._input_scale, self._output_scale
        of_a, of_b, of_c = local_directions(model.a, model.b * inputs, model.c / outputs[:, np.newaxis])
        of_b, of_c = of_b / inputs[:, np.newaxis], of_c * outputs[:, np.newaxis, np.newaxis]
        return Loop(model, initial_states, LoopDirections(of_a, of_b, of_c, np.diag(outputs)[:, : self._free]))

    def _stable(self, model: StateSpaceModel) -> bool:
        return bool(np.abs(closed_loop_poles(model, self._controller)[0]) < LARGEST_RADIUS)


def _signals(record: LoopRecord) -> tuple[Arrays, Arrays]:
    """Inputs and outputs, checked."""
    if not all(np.all(np.isfinite(signal)) for signal in (record.reference, record.position, record.current)):
        raise IdentificationError("simulation focus needs finite data; leave invalid samples out first")
    return record.current, record.position
