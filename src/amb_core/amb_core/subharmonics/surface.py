"""The size of the lowest components over amplitude and frequency of the inducing tone (paper, Fig. 7)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import Any

import numpy as np
from distributed import KilledWorker, as_completed
from distributed.comm import CommClosedError

from amb_core.control import ControllerParameters
from amb_core.errors import RegionError
from amb_core.plant import PlantParameters
from amb_core.region_map.cluster import open_cluster
from amb_core.subharmonics.results import State, SubharmonicSpectrum, SubharmonicSurface
from amb_core.subharmonics.run import check, run_subharmonics
from amb_core.subharmonics.settings import SubharmonicSettings, SurfaceSettings


@dataclass(frozen=True)
class SurfacePoint:
    """What the surface keeps of one response; see `SubharmonicSurface`."""

    state: State
    difference: float
    slow_amplitude: float
    slow_frequency: float
    slow_rms: float
    slow_origin: str
    bias: float

    @classmethod
    def of(cls, spectrum: SubharmonicSpectrum) -> SurfacePoint:
        """The point that a spectrum makes."""
        nan = float("nan")
        slow, line = spectrum.slow, spectrum.line(-1, 1)
        if slow is None or spectrum.state == "delevitated":
            return cls(spectrum.state, nan, nan, nan, nan, "", nan)
        difference = abs(line.amplitude) if line is not None and spectrum.state == "steady" else nan
        return cls(spectrum.state, difference, slow.amplitude, slow.frequency, slow.rms, slow.origin, spectrum.bias)


def subharmonic_surface(
    plant: PlantParameters,
    controller: ControllerParameters,
    settings: SubharmonicSettings | None = None,
    surface: SurfaceSettings | None = None,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SubharmonicSurface:
    """Run the subharmonic test with every inducing tone of the surface.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    settings : SubharmonicSettings, optional
        The test; its inducing tone is replaced.
    surface : SurfaceSettings, optional
        Which inducing tones.
    scheduler : str, optional
        Address of a running dask scheduler (tcp://host:port); by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    progress : callable, optional
        Called with the number of runs done and of all, at the start and after each.

    Raises
    ------
    ParameterError
        If an inducing tone has the frequency of another tone.
    ExcitationError, RegionError
        As for `run_subharmonics`; before anything is run. RegionError also if the scheduler does not answer,
        or is lost.
    """
    settings, surface = settings or SubharmonicSettings(), surface or SurfaceSettings()
    tests = _tests(settings, surface)
    for test in (test for row in tests for test in row):
        check(plant, controller, test)
    points: dict[tuple[int, int], SurfacePoint] = {}
    report = progress or (lambda done, total: None)
    total = len(tests) * len(tests[0])
    report(0, total)
    with open_cluster(scheduler, workers) as client:
        places = {
            client.submit(compute_point, plant, controller, test, pure=False): (i, j)
            for i, row in enumerate(tests)
            for j, test in enumerate(row)
        }
        for future in as_completed(places, loop=client.loop):
            try:
                points[places[future]] = future.result()
            except (CancelledError, CommClosedError, KilledWorker) as problem:
                raise RegionError(
                    f"the surface is cut off after {len(points)} of {total} runs: the workers are lost "
                    f"({type(problem).__name__})"
                ) from None
            report(len(points), total)
    return _surface(settings, surface, tests, points)


def compute_point(plant: PlantParameters, controller: ControllerParameters, test: SubharmonicSettings) -> SurfacePoint:
    """Run one test in the process of a worker."""
    return SurfacePoint.of(run_subharmonics(plant, controller, test))


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
    points: dict[tuple[int, int], SurfacePoint],
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
