"""Builds region maps: sweeps run as tasks on a cluster or come from disk; their results determine more amplitudes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from amb_core.excitation.axes import factors_of
from amb_core.ground.errors import ExcitationError, RegionError, TaskError
from amb_core.ground.given_values import require_kind
from amb_core.ground.tasks import Request, ResultCache, cache_folder, run
from amb_core.loop.control import ControllerParameters, require_one_rate
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import require_loop
from amb_core.regions import RegionParameters
from amb_core.regions.region_map.excited_axes import axes_of_first_bearing
from amb_core.regions.region_map.map_sweep import MapSweep
from amb_core.regions.region_map.refinement import Refinement
from amb_core.regions.region_map.region_map import RegionMap
from amb_core.regions.region_map.settings import MapSettings
from amb_core.regions.region_map.sweep_run import SweepTask


@dataclass(frozen=True)
class MapProgress:
    """Progress of a map, or of a grid of maps.

    Attributes
    ----------
    done : int
        Sweeps with a result.
    total : int
        Sweeps that the results so far require; it grows when boundaries need more.
    reused : int
        Number of done sweeps that were finished earlier and only read.
    map : RegionMap or None
        The sweeps so far of the map that the last finished sweep belongs to; None before the first.
    """

    done: int
    total: int
    reused: int
    map: RegionMap | None


def build_map(
    settings: MapSettings,
    plant: PlantParameters,
    controller: ControllerParameters,
    regions: RegionParameters | None = None,
    *,
    cache: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[MapProgress], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> RegionMap:
    """Build a region map.

    The map depends on the settings and the parameters alone, not on the number of workers or their speed. The function
    may be called from any thread.

    Parameters
    ----------
    settings : MapSettings
        Which sweeps, and how finely the boundaries are resolved.
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    regions : RegionParameters, optional
        Thresholds of the classifier, the defaults if None; its backup bearing is always the plant's.
    cache : Path, optional
        Folder of finished sweeps, by default `cache_folder("region_map")`. Every sweep is kept there as soon as it is
        finished.
    scheduler : str, optional
        Address of a running dask scheduler (tls://host:port) whose workers have this code; by default processes on this
        machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called in the calling thread at the start and whenever a sweep has finished. None for no calls.
    cancelled : callable, optional
        Called ten times per second; once it returns true, the map ends with the sweeps that have finished. None if it
        cannot be cancelled.

    Returns
    -------
    RegionMap
        Not `complete` if cancelled or out of `max_sweeps` before the boundaries are resolved.

    Raises
    ------
    RegionError
        If the settings do not fit the loop, a sweep fails (the loop does not hold the rotor, for example), or the map
        is cancelled before the first sweep has finished.
    TaskError
        If the scheduler does not answer, or the local processes do not start.
    PlantError
        If the plant cannot be built.
    """
    job = MapJob(settings, plant, controller, regions)
    run_jobs([job], cache, scheduler, workers, progress, cancelled)
    if job.problem is not None:
        raise job.problem
    if not job.refinement.sweeps:
        raise RegionError("the region map was cancelled before its first sweep had finished")
    return job.map()


class MapJob:
    """One map: its settings, and the sweeps so far.

    Parameters
    ----------
    settings, plant, controller, regions
        As for `build_map`.

    Attributes
    ----------
    refinement : Refinement
        Requested amplitudes, and the sweeps so far.
    problem : RegionError or None
        Why there is no map; its remaining sweeps are then not run.

    Raises
    ------
    RegionError
        If the settings do not fit the loop.
    PlantError
        If the plant cannot be built.
    """

    def __init__(
        self,
        settings: MapSettings,
        plant: PlantParameters,
        controller: ControllerParameters,
        regions: RegionParameters | None = None,
    ) -> None:
        settings = _checked(settings, plant, controller)
        radius = plant.rotor.backup_bearing_radius  # where a run ends, and with it the map
        self._regions = (regions or RegionParameters()).model_copy(update={"backup_bearing_radius": radius})
        self._settings, self._plant, self._controller = settings, plant, controller
        self.refinement = Refinement(settings)
        self.problem: RegionError | None = None

    def task(self, amplitude: float) -> SweepTask:
        """The sweep of an amplitude (m)."""
        return SweepTask(
            self._settings.sweep(amplitude), self._settings.rest, self._plant, self._controller, self._regions
        )

    @property
    def total(self) -> int:
        """Number of sweeps that the results so far require."""
        return min(len(self.refinement.amplitudes) + len(self.refinement.open), self._settings.max_sweeps)

    def map(self) -> RegionMap:
        """The map of the sweeps so far; there must be at least one."""
        described = self.task(self._settings.amplitude_low).describe()
        provenance = {name: described[name] for name in ("plant", "controller", "regions", "files", "code")}
        return RegionMap(self._settings, self.refinement.sweeps, provenance, self.refinement.resolved)


def run_jobs(
    jobs: Sequence[MapJob],
    cache: Path | None,
    scheduler: str | None,
    workers: int | None,
    progress: Callable[[MapProgress], None] | None,
    cancelled: Callable[[], bool] | None,
) -> None:
    """Run maps together on one cluster, earlier maps with priority; parameters as for `build_map`.

    If a sweep fails, the error is the `problem` of its map; the other maps continue.
    """
    sweeps = _Sweeps(jobs, progress or (lambda _: None))
    sweeps.report(None)
    first = [request for job in jobs for request in sweeps.requests(job, job.refinement.amplitudes)]
    run(first, ResultCache(cache or cache_folder("region_map")), scheduler, workers, cancelled=cancelled)


class _Sweeps:
    """The sweeps of maps that run together."""

    def __init__(self, jobs: Sequence[MapJob], progress: Callable[[MapProgress], None]) -> None:
        self._jobs, self._progress = jobs, progress
        self._reused = 0

    def requests(self, job: MapJob, amplitudes: Iterable[float]) -> list[Request[MapSweep]]:
        """Sweeps of a map at amplitudes (m), wanted as long as the map has no problem."""
        return [
            Request(
                job.task(amplitude),
                partial(self._take, job, amplitude),
                priority=-self._jobs.index(job),
                wanted=lambda: job.problem is None,
            )
            for amplitude in amplitudes
        ]

    def report(self, job: MapJob | None) -> None:
        """Report the progress of all maps, with the map of the job that has a new sweep."""
        jobs = [one for one in self._jobs if one.problem is None]
        self._progress(
            MapProgress(
                sum(len(one.refinement.sweeps) for one in jobs),
                sum(one.total for one in jobs),
                self._reused,
                None if job is None else job.map(),
            )
        )

    def _take(self, job: MapJob, amplitude: float, sweep: MapSweep | TaskError, kept: bool) -> list[Request[MapSweep]]:
        """Add a sweep; returns the sweeps that the boundaries need next."""
        if isinstance(sweep, TaskError):
            job.problem = RegionError(f"sweep of {amplitude:g} m: {sweep}")
            return []
        self._reused += kept
        amplitudes = job.refinement.add(sweep)
        self.report(job)
        return self.requests(job, amplitudes)


def _checked(settings: MapSettings, plant: PlantParameters, controller: ControllerParameters) -> MapSettings:
    """The settings with the names of the machine's axes, if the loop allows them."""
    require_kind("settings", settings, MapSettings, "MapSettings", RegionError)
    require_loop(plant, controller)
    rate = controller.sample_rate
    require_one_rate(controller.sample_rate, plant.integration.sample_rate)
    if settings.frequency_end > 0.5 * rate:
        raise RegionError(
            f"frequency_end = {settings.frequency_end:g} Hz is above the Nyquist frequency of the controller's sample "
            f"rate; allowed: up to {0.5 * rate:g} Hz"
        )
    machine = Plant(plant).machine  # rejects wrong parameters here, not on every worker
    axes = axes_of_first_bearing(settings.axes, machine)
    try:
        factors = factors_of(axes, machine)
    except ExcitationError as problem:
        raise RegionError(str(problem)) from None
    actuators = plant.magnetic_circuit.actuators
    excited = [axis for axis, factor in zip(machine.axes, factors, strict=True) if factor]
    if actuators != "two_axis" and any(axis.direction[0] for axis in excited):
        raise RegionError(
            f"axes = '{settings.axes}' is not allowed with magnetic_circuit.actuators = '{actuators}', which pull "
            "along y only; allowed: y"
        )
    reach = max(
        math.hypot(*(factors[column] for column in machine.columns_of(bearing.name))) for bearing in machine.bearings
    )
    clearance = plant.rotor.backup_bearing_radius
    if settings.amplitude_high * reach >= clearance:
        both = ", at 45 degrees with both axes" if reach > 1.0 else ""
        raise RegionError(
            f"amplitude_high = {settings.amplitude_high:g} m exceeds the clearance of {clearance:g} m to the "
            f"backup bearing{both}; allowed: below {clearance / reach:.6g} m"
        )
    return settings.model_copy(update={"axes": axes})
