"""The size of the lowest components over amplitude and frequency of the inducing tone (paper, Fig. 7)."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.ground.errors import TaskError
from amb_core.ground.progress import Progress, unseen
from amb_core.ground.tasks import Request, ResultCache, cache_folder, run
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.subharmonics.point import PointTask, SurfacePoint
from amb_core.regions.subharmonics.results import SubharmonicSurface
from amb_core.regions.subharmonics.run import check
from amb_core.regions.subharmonics.settings import SubharmonicSettings, SurfaceSettings

Place = tuple[int, int]  # in the surface, amplitude first


def subharmonic_surface(
    plant: PlantParameters,
    controller: ControllerParameters,
    settings: SubharmonicSettings | None = None,
    surface: SurfaceSettings | None = None,
    *,
    cache: Path | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> SubharmonicSurface:
    """Run the subharmonic test with every inducing tone of the surface.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    settings : SubharmonicSettings, optional
        The test; its inducing tone is replaced. The paper's if None.
    surface : SurfaceSettings, optional
        Which inducing tones. The defaults if None.
    cache : Path, optional
        Folder of finished runs, by default `cache_folder("subharmonics")`; these are not run again.
    scheduler : str, optional
        Address of a running dask scheduler (tls://host:port); by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called at the start and after each run, see `amb_core.ground.progress.Progress`. None for no calls.

    Returns
    -------
    SubharmonicSurface
        Amplitudes over frequency and amplitude of the inducing tone.

    Raises
    ------
    ParameterError
        If an inducing tone has the frequency of another tone.
    ExcitationError, SpectrumError
        As for `run_subharmonics`; before anything is run.
    TaskError
        If a run fails, or the scheduler does not answer or is lost.
    """
    settings, surface = settings or SubharmonicSettings(), surface or SurfaceSettings()
    tests = _tests(settings, surface)
    for test in (test for row in tests for test in row):
        check(plant, controller, test)
    tasks = {(i, j): PointTask(plant, controller, test) for i, row in enumerate(tests) for j, test in enumerate(row)}
    kept = ResultCache(cache or cache_folder("subharmonics"))
    points = _run(tasks, kept, scheduler, workers, progress or unseen)
    return _surface(settings, surface, tests, points)


def _run(
    tasks: dict[Place, PointTask],
    cache: ResultCache,
    scheduler: str | None,
    workers: int | None,
    progress: Progress,
) -> dict[Place, SurfacePoint]:
    """The points of all places; those that are not in the cache are computed."""
    points: dict[Place, SurfacePoint] = {}

    def take(place: Place, point: SurfacePoint | TaskError, _kept: bool) -> tuple[()]:
        if isinstance(point, TaskError):
            raise TaskError(f"the surface ends after {len(points)} of {len(tasks)} runs: {point}")
        points[place] = point
        progress("surface", len(points), len(tasks))
        return ()

    progress("surface", 0, len(tasks))
    # Rounded frequencies may be equal: their places share a task.
    run((Request(task, partial(take, place)) for place, task in tasks.items()), cache, scheduler, workers)
    return points


def _tests(settings: SubharmonicSettings, surface: SurfaceSettings) -> list[list[SubharmonicSettings]]:
    """Settings of all runs, amplitudes first."""
    amplitudes = np.linspace(surface.amplitude_low, surface.amplitude_high, surface.amplitude_count)
    periods = np.linspace(surface.frequency_low, surface.frequency_high, surface.frequency_count)
    periods = np.round(periods * settings.block_duration)
    tests = [
        [
            settings.changed(inducing_amplitude=float(amplitude), inducing_frequency=float(count))
            for count in periods / settings.block_duration
        ]
        for amplitude in amplitudes
    ]
    return [[test.shifted() for test in row] for row in tests] if surface.shifted else tests


def _surface(
    settings: SubharmonicSettings,
    surface: SurfaceSettings,
    tests: list[list[SubharmonicSettings]],
    points: dict[Place, SurfacePoint],
) -> SubharmonicSurface:
    def grid(name: str) -> list[list[Any]]:
        return [[getattr(points[i, j], name) for j in range(len(row))] for i, row in enumerate(tests)]

    return SubharmonicSurface(
        settings=settings,
        surface=surface,
        inducing_amplitude=np.array([row[0].inducing_amplitude for row in tests]),
        inducing_frequency=np.array([test.inducing_frequency for test in tests[0]]),
        difference=np.array(grid("difference"), dtype=np.float64),
        slow_amplitude=np.array(grid("slow_amplitude"), dtype=np.float64),
        slow_frequency=np.array(grid("slow_frequency"), dtype=np.float64),
        slow_rms=np.array(grid("slow_rms"), dtype=np.float64),
        slow_origin=np.array(grid("slow_origin"), dtype=np.str_),
        bias=np.array(grid("bias"), dtype=np.float64),
        state=np.array(grid("state"), dtype=np.str_),
    )
