"""Confirms a region map: bisects its boundaries with fixed sines, and repeats its sweeps at another rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from amb_core.ground.errors import RegionError, TaskError
from amb_core.ground.tasks import Request, ResultCache, cache_folder, run
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map.bisection import BoundarySearch
from amb_core.regions.region_map.build import MapJob, MapProgress
from amb_core.regions.region_map.confirmation import DIRECTIONS, Confirmation, Direction, DwellBoundary
from amb_core.regions.region_map.dwell_run import Dwell, DwellTask
from amb_core.regions.region_map.map_sweep import MapSweep
from amb_core.regions.region_map.region_map import RegionMap
from amb_core.regions.region_map.settings import ConfirmationSettings, MapSettings
from amb_core.regions.region_map.sweep_run import SweepTask


def confirm_map(
    region_map: RegionMap,
    plant: PlantParameters,
    controller: ControllerParameters,
    regions: RegionParameters | None = None,
    settings: ConfirmationSettings | None = None,
    *,
    cache: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[MapProgress], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> RegionMap:
    """Confirm the boundaries of a region map with fixed sines and with sweeps at another rate.

    At every amplitude of the map, the first boundary and every boundary that its sweep has are bisected, down to the
    map's `resolution`, from below and then from above; see `DwellBoundary`. The result depends on the map, the settings
    and the parameters alone.

    Parameters
    ----------
    region_map : RegionMap
        The map; a confirmation that it already has is replaced.
    plant, controller : PlantParameters, ControllerParameters
        The loop that the map was made with.
    regions : RegionParameters, optional
        Thresholds that the map was made with; the defaults if None.
    settings : ConfirmationSettings, optional
        The dwells, and the rate of the other sweeps; the defaults if None.
    cache : Path, optional
        Folder of finished dwells and sweeps, by default `cache_folder("region_map")`.
    scheduler : str, optional
        Address of a running dask scheduler (tls://host:port); by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called in the calling thread at the start and whenever a dwell or sweep has finished. The total grows until all
        boundaries are bracketed. None for no calls.
    cancelled : callable, optional
        Called ten times per second; once it returns true, the confirmation ends with what has finished. None if it
        cannot be cancelled.

    Returns
    -------
    RegionMap
        The same map with its `confirmation`, not `complete` if cancelled.

    Raises
    ------
    RegionError
        If the map does not fit the loop, or a dwell or sweep fails.
    TaskError
        If the scheduler does not answer, or the local processes do not start.
    PlantError
        If the plant cannot be built.
    """
    work = _Work(
        region_map, plant, controller, regions, settings or ConfirmationSettings(), progress or (lambda _: None)
    )
    work.report()
    run(
        work.first_requests(),
        ResultCache(cache or cache_folder("region_map")),
        scheduler,
        workers,
        cancelled=cancelled,
    )
    if work.problem is not None:
        raise work.problem
    return work.map()


class _BoundaryWork:
    """The search for one boundary at one amplitude: from below, then from above.

    Parameters
    ----------
    sweep : MapSweep
        The sweep of the amplitude.
    region : Region
        The region that begins; a dwell in a higher region counts as beyond the boundary.
    settings : MapSettings
        Limits and resolution of the search.
    """

    def __init__(self, sweep: MapSweep, region: Region, settings: MapSettings) -> None:
        self.sweep, self.region = sweep, region
        self._limits = (settings.frequency_start, settings.frequency_end)
        self._resolution = settings.resolution
        self._entered: dict[float, Dwell] = {}  # dwells beyond the boundary from this direction, by frequency
        self._directions = list(DIRECTIONS)
        self.boundaries: list[DwellBoundary] = []
        own = sweep.boundaries.get(region)
        first = min((edge.frequency for edge in sweep.boundaries.values()), default=sweep.highest_frequency)
        self._search = self._begin([own.frequency if own is not None else first])

    @property
    def direction(self) -> Direction:
        """Direction that is being searched."""
        return self._directions[0]

    @property
    def remaining(self) -> int:
        """Number of directions that are not done."""
        return len(self._directions)

    @property
    def frequency(self) -> float | None:
        """Frequency of the next dwell (Hz); None if both directions are done."""
        return self._search.frequency if self._directions else None

    def add(self, dwell: Dwell) -> None:
        """Add the result of the dwell that was next."""
        inside = dwell.region >= self.region
        if inside:
            self._entered[dwell.frequency] = dwell
        self._search.add(dwell.frequency, inside)
        if self._search.frequency is None:
            self._conclude()

    def _begin(self, guesses: list[float]) -> BoundarySearch:
        self._entered.clear()
        return BoundarySearch(guesses, self._limits, self._resolution)

    def _conclude(self) -> None:
        low, high = self._search.low, self._search.high
        entered = self._entered.get(high)
        reached = entered is None or entered.started
        # If the sweep lacks this boundary, the fixed sine may lead straight into a higher region.
        swept = self.region in self.sweep.boundaries
        region = self.region if swept or entered is None else entered.region
        if swept or region not in self.sweep.boundaries:  # else the search for the higher region finds it
            self.boundaries.append(DwellBoundary(self.sweep.amplitude, region, self.direction, low, high, reached))
        del self._directions[0]
        if self._directions:
            # Without hysteresis the bracket found from below holds from above too.
            self._search = self._begin([one for one in (low, high) if 0.0 < one < math.inf])


class _Work:
    """Dwells and sweeps that confirm a map, with the results so far; parameters as for `confirm_map`."""

    def __init__(
        self,
        region_map: RegionMap,
        plant: PlantParameters,
        controller: ControllerParameters,
        regions: RegionParameters | None,
        settings: ConfirmationSettings,
        progress: Callable[[MapProgress], None],
    ) -> None:
        self._map, self._settings, self._progress = region_map, settings, progress
        self._job = MapJob(region_map.settings, plant, controller, regions)
        self._highest = 0.5 * controller.sample_rate
        self._searches = [
            _BoundaryWork(sweep, region, region_map.settings)
            for sweep in region_map.sweeps
            for region in sorted({Region.B, *sweep.boundaries})
        ]
        other = region_map.settings.at_rate(settings.rate_factor)
        self._sweep_tasks = [
            replace(self._job.task(sweep.amplitude), sweep=other.sweep(sweep.amplitude)) for sweep in region_map.sweeps
        ]
        self._sweeps: dict[float, MapSweep] = {}
        self._done, self._reused = 0, 0
        self.problem: RegionError | None = None

    def first_requests(self) -> list[Request[Any]]:
        """The first dwell of every boundary, and the sweeps."""
        dwells = [request for search in self._searches for request in self._next(search)]
        # Sweeps take longer than dwells but nothing waits for them: they fill the time in which searches wait.
        return dwells + [self._sweep_request(task) for task in self._sweep_tasks]

    def report(self) -> None:
        """Report the progress, with the map and its confirmation so far."""
        waiting = sum(search.remaining for search in self._searches)
        total = self._done + waiting + len(self._sweep_tasks) - len(self._sweeps)
        self._progress(MapProgress(self._done, total, self._reused, self.map() if self._done else None))

    def map(self) -> RegionMap:
        """The map with its confirmation so far."""
        dwells = [one for search in self._searches for one in search.boundaries]
        dwells.sort(key=lambda one: (one.amplitude, one.region, DIRECTIONS.index(one.direction)))
        sweeps = tuple(self._sweeps[amplitude] for amplitude in sorted(self._sweeps))
        complete = len(sweeps) == len(self._sweep_tasks) and not any(search.remaining for search in self._searches)
        return replace(self._map, confirmation=Confirmation(self._settings, tuple(dwells), sweeps, complete))

    def _next(self, search: _BoundaryWork) -> list[Request[Any]]:
        frequency = search.frequency
        if frequency is None:
            return []
        task = DwellTask(
            self._job.task(search.sweep.amplitude), frequency, self._start(search, frequency), self._settings
        )
        return [Request(task, partial(self._take_dwell, search), priority=1, wanted=self._wanted)]

    def _start(self, search: _BoundaryWork, frequency: float) -> float:
        """Frequency at which the sine starts (Hz). The rotor cannot come back from D: it starts from rest at once."""
        if search.direction == "below":
            return frequency / self._settings.approach
        return frequency if search.region is Region.D else min(frequency * self._settings.approach, self._highest)

    def _sweep_request(self, task: SweepTask) -> Request[Any]:
        return Request(task, partial(self._take_sweep, task.sweep.amplitude), wanted=self._wanted)

    def _wanted(self) -> bool:
        return self.problem is None

    def _take_dwell(self, search: _BoundaryWork, dwell: Dwell | TaskError, kept: bool) -> Iterable[Request[Any]]:
        if isinstance(dwell, TaskError):
            return self._fail(f"fixed sine of {search.sweep.amplitude:g} m: {dwell}")
        search.add(dwell)
        self._count(kept)
        return self._next(search)

    def _take_sweep(self, amplitude: float, sweep: MapSweep | TaskError, kept: bool) -> Iterable[Request[Any]]:
        if isinstance(sweep, TaskError):
            return self._fail(f"sweep of {amplitude:g} m at another rate: {sweep}")
        self._sweeps[amplitude] = sweep
        self._count(kept)
        return []

    def _fail(self, text: str) -> list[Request[Any]]:
        self.problem = self.problem or RegionError(text)
        return []

    def _count(self, kept: bool) -> None:
        self._done += 1
        self._reused += kept
        self.report()
