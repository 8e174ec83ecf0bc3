"""A grid of region maps: how the boundaries move with parameters of the design."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from amb_core.ground.errors import AmbError, RegionError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.simulation.parameters import CONTROLLER, loop_parameter_names, with_values
from amb_core.regions import RegionParameters
from amb_core.regions.region_map.build import MapJob, MapProgress, run_jobs
from amb_core.regions.region_map.region_map import RegionMap
from amb_core.regions.region_map.settings import MapSettings


@dataclass(frozen=True)
class GridCell:
    """One map of a grid.

    Attributes
    ----------
    values : dict
        Value of each design parameter.
    plant, controller : PlantParameters, ControllerParameters, or None
        The loop; None if the values do not make one.
    map : RegionMap or None
        None if there is none, see `problem`.
    problem : str
        Why there is no map: rejected values, a loop that does not hold the rotor, or a cancellation; else empty.
    """

    values: dict[str, Any]
    plant: PlantParameters | None
    controller: ControllerParameters | None
    map: RegionMap | None
    problem: str


def build_grid(
    settings: MapSettings,
    plant: PlantParameters,
    controller: ControllerParameters,
    design: Mapping[str, Sequence[Any]],
    regions: RegionParameters | None = None,
    *,
    cache: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[MapProgress], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> list[GridCell]:
    """Build a map for every combination of values of design parameters, all on one cluster.

    Parameters
    ----------
    settings : MapSettings
        Which sweeps, and how finely the boundaries are resolved.
    plant : PlantParameters
        The machine; parameters that `design` does not name are the same in all maps.
    controller : ControllerParameters
        Its gains, likewise.
    design : mapping
        Values by name: a dotted name of `PlantParameters` (amplifier.bias_current, rotor.gravity) or `controller.` and
        a name of `ControllerParameters` (controller.derivative_gain). The last name varies fastest.
    regions : RegionParameters, optional
        Thresholds of the classifier; the defaults if None.
    cache : Path, optional
        Folder of finished sweeps, by default `cache_folder("region_map")`.
    scheduler : str, optional
        Address of a running dask scheduler (tls://host:port); by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called in the calling thread at the start and whenever a sweep has finished; None for no calls.
    cancelled : callable, optional
        Called ten times per second; once it returns true, no further sweep is begun. None if it cannot be cancelled.

    Returns
    -------
    list of GridCell
        In the order of the combinations.

    Raises
    ------
    RegionError
        If a name is unknown, a parameter has no value, the scheduler does not answer, or no map can be made at all.
    """
    _check_names(design)
    cells: list[GridCell] = []
    jobs: list[MapJob | None] = []
    for combination in itertools.product(*design.values()):
        values = dict(zip(design, combination, strict=True))
        try:
            loop = with_values(plant, controller, values)
            jobs.append(MapJob(settings, *loop, regions))
            cells.append(GridCell(values, *loop, None, ""))
        except AmbError as problem:
            jobs.append(None)
            cells.append(GridCell(values, None, None, None, str(problem)))
    if not any(jobs):
        raise RegionError(f"none of the {len(cells)} maps of the grid can be made; the first: {cells[0].problem}")
    run_jobs([job for job in jobs if job is not None], cache, scheduler, workers, progress, cancelled)
    return [cell if job is None else _finished(cell, job) for cell, job in zip(cells, jobs, strict=True)]


def _finished(cell: GridCell, job: MapJob) -> GridCell:
    if job.problem is not None:
        return replace(cell, problem=str(job.problem))
    if not job.refinement.sweeps:
        return replace(cell, problem="cancelled before its first sweep had finished")
    return replace(cell, map=job.map())


def _check_names(design: Mapping[str, Sequence[Any]]) -> None:
    known = loop_parameter_names()
    if not design:
        raise RegionError("a grid of maps needs at least one design parameter")
    for name, values in design.items():
        if name not in known:
            hint = "; that of the controller is 'controller." + name + "'" if CONTROLLER + name in known else ""
            raise RegionError(
                f"unknown design parameter '{name}'{hint}; allowed: names of the plant's parameters, such as "
                "amplifier.bias_current or rotor.gravity, and of the controller's, such as controller.derivative_gain"
            )
        if not values:
            raise RegionError(f"design parameter '{name}' has no value")
