"""Builds a region map: sweeps as tasks on a cluster, finished ones from disk, amplitudes as the results ask for."""

from __future__ import annotations

import math
import queue
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Client, Future

from amb_core.control import ControllerParameters
from amb_core.errors import RegionError
from amb_core.plant import PlantParameters
from amb_core.region_map.cache import SweepCache, compute, default_folder
from amb_core.region_map.cluster import open_cluster
from amb_core.region_map.refinement import Refinement
from amb_core.region_map.region_map import MapSweep, RegionMap
from amb_core.region_map.settings import MapSettings
from amb_core.region_map.sweep_run import SweepTask
from amb_core.regions import RegionParameters

POLL = 0.1  # s, how often `cancelled` is asked


@dataclass(frozen=True)
class MapProgress:
    """How far a map is.

    Attributes
    ----------
    done : int
        Sweeps with a result.
    total : int
        Sweeps that the results so far ask for; it grows as boundaries turn out to need more.
    reused : int
        Of those done, how many were finished earlier and only read.
    map : RegionMap or None
        Map of the sweeps so far; None before the first.
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

    The map depends on the settings and the parameters alone, not on the number of workers or their speed. May be
    called from any thread.

    Parameters
    ----------
    settings : MapSettings
        Which sweeps, and how finely the boundaries are resolved.
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    regions : RegionParameters, optional
        Thresholds of the classifier; by default those of `RegionParameters`, with the plant's backup bearing.
    cache : Path, optional
        Folder of finished sweeps, by default `default_folder()`. Every sweep is kept there as soon as it is finished.
    scheduler : str, optional
        Address of a running dask scheduler (tcp://host:port) whose workers have this code; by default processes on
        this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called in the calling thread at the start and whenever sweeps have finished.
    cancelled : callable, optional
        Asked ten times a second; once it is true, no more sweeps are run.

    Returns
    -------
    RegionMap
        Not `complete` if cancelled or out of `max_sweeps` before the boundaries are resolved.

    Raises
    ------
    RegionError
        If the settings do not fit the loop, the scheduler does not answer, a worker fails again and again, the loop
        does not hold the rotor, or the map is cancelled before the first sweep has finished.
    """
    regions = regions or RegionParameters(backup_bearing_radius=plant.rotor.backup_bearing_radius)
    check(settings, plant, controller)
    with open_cluster(scheduler, workers) as client:
        work = _MapWork(settings, plant, controller, regions, SweepCache(cache or default_folder()))
        work.run(client, progress or (lambda _: None), cancelled or (lambda: False))
        return work.map()


def check(settings: MapSettings, plant: PlantParameters, controller: ControllerParameters) -> None:
    """Refuse settings that do not fit the loop.

    Raises
    ------
    RegionError
        If the sweep reaches above the Nyquist frequency or beyond the backup bearing, excites an axis along which the
        rotor cannot move, or plant and controller are sampled at different rates.
    """
    rate = controller.sample_rate
    if abs(rate - plant.integration.sample_rate) > 1e-9 * rate:
        raise RegionError(
            f"the controller runs at {rate:g} Hz, the plant is sampled at {plant.integration.sample_rate:g} Hz; "
            "the two rates must be equal"
        )
    if settings.frequency_end > 0.5 * rate:
        raise RegionError(
            f"frequency_end = {settings.frequency_end:g} Hz is above the Nyquist frequency of the controller's sample "
            f"rate; allowed: up to {0.5 * rate:g} Hz"
        )
    actuators = plant.magnetic_circuit.actuators
    if actuators != "two_axis" and settings.axes != "y":
        raise RegionError(
            f"axes = '{settings.axes}' is not allowed with magnetic_circuit.actuators = '{actuators}', which pull "
            "along y only; allowed: y"
        )
    clearance = plant.rotor.backup_bearing_radius
    allowed = clearance / math.sqrt(2.0) if settings.axes == "both" else clearance
    if settings.amplitude_high >= allowed:
        both = ", at 45 degrees with both axes" if settings.axes == "both" else ""
        raise RegionError(
            f"amplitude_high = {settings.amplitude_high:g} m reaches beyond the clearance of "
            f"{clearance:g} m to the backup bearing{both}; allowed: below {allowed:.6g} m"
        )


class _MapWork:
    """A map on its way."""

    def __init__(
        self,
        settings: MapSettings,
        plant: PlantParameters,
        controller: ControllerParameters,
        regions: RegionParameters,
        cache: SweepCache,
    ) -> None:
        self._settings, self._plant, self._controller, self._regions = settings, plant, controller, regions
        self._cache = cache
        self._refinement = Refinement(settings)
        self._reused = 0

    def run(self, client: Client, progress: Callable[[MapProgress], None], cancelled: Callable[[], bool]) -> None:
        finished: queue.Queue[Future] = queue.Queue()
        tasks: dict[str, tuple[SweepTask, Future]] = {}
        self._start(self._refinement.amplitudes, client, tasks, finished)
        progress(self.progress())
        while not self._refinement.finished and not cancelled():
            try:
                future = finished.get(timeout=POLL)
            except queue.Empty:
                continue
            task, _ = tasks.pop(future.key)
            sweep = self._result(future, task)
            self._start(self._refinement.add(sweep), client, tasks, finished)
            progress(self.progress())
        client.cancel([future for _, future in tasks.values()])

    def _start(
        self,
        amplitudes: list[float],
        client: Client,
        tasks: dict[str, tuple[SweepTask, Future]],
        finished: queue.Queue[Future],
    ) -> None:
        """Get the sweeps of some amplitudes under way; those that are on disk are finished at once."""
        waiting = list(amplitudes)
        while waiting:
            task = self._task(waiting.pop(0))
            key = task.key()
            sweep = self._cache.load(key)
            if sweep is not None:
                self._reused += 1
                waiting += self._refinement.add(sweep)
                continue
            future = client.submit(compute, task, key, self._cache.folder, key=f"amb-sweep-{key}")
            tasks[future.key] = task, future
            future.add_done_callback(finished.put)

    def _result(self, future: Future, task: SweepTask) -> MapSweep:
        try:
            return future.result()
        except RegionError as problem:
            raise RegionError(f"sweep of {task.sweep.amplitude:g} m: {problem}") from None

    def _task(self, amplitude: float) -> SweepTask:
        return SweepTask(
            self._settings.sweep(amplitude), self._settings.rest, self._plant, self._controller, self._regions
        )

    def progress(self) -> MapProgress:
        refinement = self._refinement
        done = len(refinement.sweeps)
        total = min(len(refinement.amplitudes) + len(refinement.open), self._settings.max_sweeps)
        return MapProgress(done, total, self._reused, self.map() if done else None)

    def map(self) -> RegionMap:
        """The map so far."""
        sweeps = self._refinement.sweeps
        if not sweeps:
            raise RegionError("the region map was cancelled before its first sweep had finished")
        return RegionMap(self._settings, sweeps, self._provenance(), self._refinement.resolved)

    def _provenance(self) -> dict[str, Any]:
        described = self._task(self._settings.amplitude_low).describe()
        return {name: described[name] for name in ("plant", "controller", "regions", "files", "code")}
