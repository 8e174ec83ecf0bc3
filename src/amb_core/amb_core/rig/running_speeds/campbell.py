"""The Campbell diagram by identification: models at several running speeds, compared with the computed modes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.ground.errors import PlantError, TaskError
from amb_core.ground.given_values import numbers
from amb_core.ground.parameters import flatten, given_set, validate
from amb_core.ground.progress import Progress, unseen
from amb_core.ground.results import plain
from amb_core.ground.tasks import Request, ResultCache, cache_folder, run
from amb_core.identification.modes import closed_loop_modes
from amb_core.linear.model.mode_pairs import ModeComparison, pair_modes
from amb_core.linear.model.modes import Mode, Modes
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.control import ControllerParameters, require_one_rate
from amb_core.plant import PlantParameters
from amb_core.plant.campbell import Campbell, campbell
from amb_core.plant.simulation import require_loop
from amb_core.rig.running_speeds.settings import SpeedSettings
from amb_core.rig.running_speeds.speed_run import SpeedTask

CURVE_SPEEDS = 13
"""Running speeds at which the modes are computed at least, so that the curves are smooth."""
_RPM = 60.0


@dataclass(frozen=True, eq=False)
class SpeedResult:
    """One running speed.

    Attributes
    ----------
    speed : float
        Running speed (Hz).
    model : StateSpaceModel or None
        The identified plant; None if there is none.
    modes : Modes or None
        Its modes in the loop. None without a model.
    comparison : ModeComparison or None
        These beside the computed ones. None without a model.
    problem : str
        Why there is no model; empty if there is one.
    """

    speed: float
    model: StateSpaceModel | None = None
    modes: Modes | None = None
    comparison: ModeComparison | None = None
    problem: str = ""

    @property
    def rpm(self) -> float:
        """Running speed in revolutions per minute."""
        return _RPM * self.speed

    @property
    def worst_percent(self) -> float | None:
        """Largest magnitude of the relative error of a paired frequency (percent); None without a pair."""
        if self.comparison is None or not self.comparison.pairs:
            return None
        return 100.0 * max(abs(pair.frequency_error) for pair in self.comparison.pairs)

    def to_json(self) -> dict[str, Any]:
        """Fit and order of the model, pairs of modes, and the oscillating modes of either side without a partner.

        Returns
        -------
        dict of str to object
            JSON values by name.
        """
        if self.model is None or self.comparison is None:
            return {"rpm": self.rpm, "problem": self.problem}
        fit = plain(self.model.fit)
        return {
            "rpm": self.rpm,
            "order": self.model.order,
            "fit": dict(zip(self.model.output_names, fit, strict=False)),
            "unstable_poles": len(self.model.unstable_poles()),
            "largest_frequency_error_percent": self.worst_percent,
            "modes": [pair.to_json() for pair in self.comparison.pairs],
            "missing": [_frequency(mode) for mode in self.comparison.missing if mode.oscillates],
            "surplus": [_frequency(mode) for mode in self.comparison.surplus if mode.oscillates],
        }


@dataclass(frozen=True, eq=False)
class IdentifiedCampbell:
    """Computed and identified modes over the running speed.

    Attributes
    ----------
    computed : Campbell
        Modes of the plant in the loop.
    results : tuple of SpeedResult
        Results of the experiments, slowest first.
    """

    computed: Campbell
    results: tuple[SpeedResult, ...]

    @property
    def identified(self) -> tuple[tuple[float, Modes], ...]:
        """Running speeds (Hz) with the modes of the identified loop there."""
        return tuple((result.speed, result.modes) for result in self.results if result.modes is not None)

    @property
    def worst_percent(self) -> float | None:
        """Largest magnitude of the relative error of a paired frequency at all speeds (percent)."""
        worst = [result.worst_percent for result in self.results if result.worst_percent is not None]
        return max(worst, default=None)

    def to_json(self) -> dict[str, Any]:
        """Results of all speeds, and the computed critical speeds.

        Returns
        -------
        dict of str to object
            JSON values by name.
        """
        computed = self.computed.to_json()
        return {
            "stable": computed["stable"],
            "not_followed_rpm": computed["not_followed_rpm"],
            "largest_frequency_error_percent": self.worst_percent,
            "critical_speeds": computed["critical_speeds"],
            "speeds": [result.to_json() for result in self.results],
        }

    def rows(self) -> list[dict[str, Any]]:
        """One mapping for each oscillating mode that is computed or identified, without what is missing of it.

        Returns
        -------
        list of dict of str to object
            Values by column name.
        """
        return [row for result in self.results if result.comparison is not None for row in _rows(result)]


def identify_over_speeds(
    plant: PlantParameters,
    controller: ControllerParameters,
    speeds: Iterable[float],
    settings: SpeedSettings | None = None,
    *,
    cache: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> IdentifiedCampbell | None:
    """Simulate an experiment at each running speed, identify a model, and compare its modes with the computed ones.

    The result depends on the parameters alone, not on the number of workers. Finished models are kept on disk.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop; the running speed of the plant has no influence.
    speeds : iterable of float
        Running speeds (Hz), ascending.
    settings : SpeedSettings, optional
        The experiments. The defaults if None.
    cache : Path, optional
        Folder of finished models, by default `cache_folder("running_speeds")`.
    scheduler : str, optional
        Address of a running dask scheduler (tls://host:port); by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called in this thread after each speed, see `amb_core.ground.progress.Progress`. None for no calls.
    cancelled : callable, optional
        Called ten times per second; once it returns true, the function returns None. None if it cannot be cancelled.

    Returns
    -------
    IdentifiedCampbell or None
        The modes of all speeds; None if it was cancelled.

    Raises
    ------
    PlantError
        If the speeds do not ascend, the controller cannot hold the rotor, or no speed gives a model.
    ParameterError
        If a speed is out of its range, or the sample rates of plant and controller differ.
    TaskError
        If the scheduler does not answer, or the local processes do not start.
    """
    require_loop(plant, controller)
    speed = numbers("speeds", speeds, PlantError).ravel().tolist()
    if not speed or np.any(np.diff(speed) <= 0.0):
        raise PlantError(f"running speeds {speed} Hz are not allowed; needed: at least one, ascending")
    require_one_rate(controller.sample_rate, plant.integration.sample_rate)
    settings = given_set(SpeedSettings, "settings", settings)
    models: dict[float, StateSpaceModel | TaskError] = {}
    report = progress or unseen

    def take(value: float, result: StateSpaceModel | TaskError, kept: bool) -> list[Request[StateSpaceModel]]:
        models[value] = result
        report("experiments", len(models), len(speed))
        return []

    report("experiments", 0, len(speed))
    requests = [Request(SpeedTask(settings, _at(plant, value), controller), partial(take, value)) for value in speed]
    computed: list[Campbell] = []
    curve = sorted({*speed, *np.linspace(speed[0], speed[-1], CURVE_SPEEDS if len(speed) > 1 else 1).tolist()})
    run(
        requests,
        ResultCache(cache or cache_folder("running_speeds")),
        scheduler,
        workers,
        cancelled=cancelled,
        meanwhile=lambda: computed.append(campbell(plant, controller, curve)),
    )
    if len(models) < len(speed):
        return None
    at_speed = dict(zip(computed[0].speed.tolist(), computed[0].closed_loop, strict=True))
    results = tuple(_result(value, models[value], controller, at_speed[value]) for value in speed)
    if all(result.model is None for result in results):
        raise PlantError(f"no running speed gives a model; at {results[0].rpm:.0f} rpm: {results[0].problem}")
    return IdentifiedCampbell(computed[0], results)


def _at(plant: PlantParameters, speed: float) -> PlantParameters:
    return validate(PlantParameters, {**flatten(plant.model_dump()), "rotor.running_speed": speed})


def _result(
    speed: float, model: StateSpaceModel | TaskError, controller: ControllerParameters, computed: Modes
) -> SpeedResult:
    if isinstance(model, TaskError):
        return SpeedResult(speed, problem=str(model))
    modes = closed_loop_modes(model, controller)
    return SpeedResult(speed, model, modes, pair_modes(modes, computed))


def _frequency(mode: Mode) -> dict[str, Any]:
    return {
        "kind": mode.kind,
        "natural_hz": mode.natural_hz,
        "damping_ratio": mode.damping_ratio,
        "whirl": mode.whirl,
        "gain": mode.gain,
    }


def _rows(result: SpeedResult) -> Iterable[dict[str, Any]]:
    assert result.comparison is not None
    names = ("natural_hz", "damping_ratio", "whirl")
    for pair in result.comparison.pairs:
        yield {"rpm": result.rpm, **pair.to_json()}
    for side, modes in (("computed", result.comparison.missing), ("identified", result.comparison.surplus)):
        for mode in (mode for mode in modes if mode.oscillates):
            yield {"rpm": result.rpm, "kind": mode.kind, **{f"{side}_{name}": getattr(mode, name) for name in names}}
