"""Trials of identification over data sets, orders and methods: is the closed loop of the model stable?

Unlike in `amb_core.identification.identify`, no check of the data refuses a trial: here the question is whether the
data determine a model.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.designs.excitation import Trial, TrialBench
from amb_core.excitation import Excitation, generate
from amb_core.ground.errors import IdentificationError, TaskError
from amb_core.ground.tasks import Request, ResultCache, Task, run
from amb_core.ground.tasks.provenance import code_version
from amb_core.identification import IdentificationData, StateSpaceModel, closed_loop_poles, nrmse_fit
from amb_core.identification.estimate.methods import estimate
from amb_core.identification.experiment_simulation import simulate_experiment
from amb_core.identification.progress import Watch
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_paper.study import StudyError, Workplace


@dataclass(frozen=True)
class DataSet:
    """The last samples of the paper's bearing under an excitation, until that ends or the rotor delevitates."""

    name: str
    excitation: Excitation
    samples: int

    def trial(self) -> Trial:
        """The simulation of the bearing, and the region in which it ran; kept in this process."""
        return _trial(self)

    def data(self) -> IdentificationData:
        """The samples for identification, not earlier than the start of the excitation."""
        record = self.trial().record
        excited = int(np.argmax(np.any(record.reference != 0.0, axis=1)))
        first = max(excited, record.steps - self.samples)
        return IdentificationData.from_record(record.window(first, record.steps - first), self.name)


@dataclass(frozen=True)
class ModelTrial:
    """Result of a method and an order on a data set.

    Attributes
    ----------
    data, method : str
        Names.
    order : int
        Number of states.
    radius : float or None
        Magnitude of the largest pole of model and controller; None if there is no model.
    fit : float or None
        Closed-loop fit of the worse axis (percent); None if the simulation diverges or there is no model.
    problem : str
        Why there is no model.
    """

    data: str
    method: str
    order: int
    radius: float | None
    fit: float | None
    problem: str = ""

    @property
    def stable(self) -> bool:
        """Whether all poles of the closed loop are stable, and its simulation under the data's reference is bounded."""
        return self.radius is not None and self.radius < 1.0 and self.fit is not None


class ModelTask(Task[ModelTrial]):
    """Identifies one model and simulates it in closed loop."""

    def __init__(self, data: DataSet, method: str, order: int) -> None:
        self.data, self.method, self.order = data, method, order

    def describe(self) -> dict[str, Any]:
        """Data, method, order, and the version of the code."""
        return {
            "excitation": [self.data.excitation.kind, self.data.excitation.model_dump()],
            "name": self.data.name,
            "samples": self.data.samples,
            "method": self.method,
            "order": self.order,
            "library": code_version(),
            "module": hashlib.sha256(Path(__file__).read_bytes()).hexdigest(),
        }

    def run(self) -> ModelTrial:
        """Identify; if a method gives several models, the best one counts."""
        data, controller = self.data.data(), ControllerParameters()
        try:
            models = estimate(data, self.order, self.method, Watch(), self.data.name)
        except IdentificationError as problem:
            return ModelTrial(self.data.name, self.method, self.order, None, None, str(problem))
        trials = [self._judge(model, data, controller) for model in models]
        return max(trials, key=lambda trial: (trial.stable, -np.inf if trial.fit is None else trial.fit))

    @staticmethod
    def to_json(result: ModelTrial, /) -> dict[str, Any]:
        """A result as JSON values."""
        return asdict(result)

    @staticmethod
    def from_json(entry: dict[str, Any], /) -> ModelTrial:
        """The result that `to_json` wrote."""
        return ModelTrial(**entry)

    def _judge(self, model: StateSpaceModel, data: IdentificationData, controller: ControllerParameters) -> ModelTrial:
        radius = float(np.abs(closed_loop_poles(model, controller)).max())
        try:
            position = simulate_experiment(model, data, 0, controller).position
            fit: float | None = float(nrmse_fit(data.record(0).position, position).min())
        except IdentificationError:
            fit = None
        return ModelTrial(self.data.name, self.method, self.order, radius, fit)


def run_trials(
    tasks: Sequence[ModelTask], workplace: Workplace, meanwhile: Callable[[], None] = lambda: None
) -> list[ModelTrial]:
    """Results of all tasks in their order, from the cluster or the cache of a workplace.

    Parameters
    ----------
    tasks : sequence of ModelTask
        What to run.
    workplace : Workplace
        Where.
    meanwhile : callable, optional
        Called once, while the cluster is busy.

    Raises
    ------
    StudyError
        If a task fails.
    TaskError
        If the scheduler does not answer, or is lost.
    """
    trials: dict[int, ModelTrial] = {}

    def take(number: int, trial: ModelTrial | TaskError, _kept: bool) -> tuple[()]:
        if isinstance(trial, TaskError):
            task = tasks[number]
            raise StudyError(f"{task.data.name}, {task.method}, order {task.order}: {trial}")
        trials[number] = trial
        workplace.report(f"model {len(trials)} of {len(tasks)}")
        return ()

    requests = [Request(task, partial(take, number)) for number, task in enumerate(tasks)]
    run(requests, ResultCache(workplace.cache), workplace.scheduler, workplace.workers, meanwhile=meanwhile)
    return [trials[number] for number in range(len(tasks))]


@functools.cache
def _trial(data: DataSet) -> Trial:
    controller = ControllerParameters()
    return TrialBench(PlantParameters(), controller).run(generate(data.excitation, controller.sample_rate))
