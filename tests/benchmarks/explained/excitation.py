"""The page on excitations: signals on region maps against trials in simulation, designs, and crest factors.

The map of the paper's bearing is that of `amb map` with its defaults: sweeps on y from 5 to 100 um.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from amb_core.ground.parameters import validate
from amb_core.ground.units import UM
from amb_core.regions import Region
from amb_core.regions.region_map import MapSettings, RegionMap
from amb_core.regions.region_map.build import MapJob
from amb_core.regions.region_map.sweep_run import run_sweep
from tests.benchmarks.explained.excitation_trials import (
    SLOW,
    Case,
    Loop,
    beyond_the_voltage,
    crest_factor,
    designed,
    fit_of_new_seeds,
    largest_in_a,
    on_map_and_in_trial,
)
from tests.benchmarks.regions.spread import spread
from tests.front_door.figures import Figures

Key = TypeVar("Key")

LONG = 4.0  # s, of signals unless stated
SLOW_LONG = 1.0  # s, on the slow amplifier
SLOW_SWEEPS = 8  # of its map
NEW_SEEDS = 4
WHOLE = 0.999  # share of the power above which all of a signal counts as in A

BOTH_OPTIMISED = {"phasing": "optimised", "interleaved": True}
TO_2000 = {"frequency_start": 1.0, "frequency_end": 2000.0}
TO_5000 = {"frequency_start": 10.0, "frequency_end": 5000.0}
SLOW_SIGNAL = {"frequency_end": 2000.0, **BOTH_OPTIMISED}
SLOW_AMPLITUDES = (1.14, 2.3, 4.5, 9.0, 18.0)  # um

SIGNALS: dict[str, tuple[str, dict[str, Any], tuple[float, ...]]] = {
    "square": ("square", {}, (25.0, 50.0, 70.0, 80.0)),
    "multisine_400": ("multisine", {}, (25.0, 50.0, 100.0)),
    "multisine_2000": ("multisine", TO_2000, (5.0, 10.0, 15.0, 40.0)),
    "noise_400": ("white_noise", {}, (5.0, 10.0, 15.0, 30.0)),
    "noise_5000": ("white_noise", TO_5000, (1.0, 2.0, 4.0, 8.0)),
    "prbs": ("prbs", {}, (10.0, 20.0, 40.0, 60.0)),
    "sweep": ("sweep", {"axes": "y"}, (5.0, 10.0, 25.0, 50.0)),
}
"""Kind, fields and amplitudes (um) of the signals on the map; fields not given are the defaults."""

LARGEST: dict[str, tuple[str, dict[str, Any]]] = {
    "square": ("square", {}),
    "sweep_as_map": ("sweep", {**TO_5000, "axes": "y", "duration": 20.0}),
    "sweep_logarithmic": (
        "sweep",
        {"frequency_start": 10.0, "frequency_end": 1000.0, "spacing": "logarithmic", "axes": "y", "duration": 10.0},
    ),
    "multisine_400": ("multisine", {}),
    "multisine_400_y": ("multisine", {"axes": "y"}),
    "optimised": ("multisine", BOTH_OPTIMISED),
    "schroeder": ("multisine", {"phasing": "schroeder", "interleaved": True}),
    "multisine_2000": ("multisine", TO_2000),
    "noise_400": ("white_noise", {}),
    "noise_5000": ("white_noise", TO_5000),
    "sweep": ("sweep", {"axes": "y"}),
    "prbs": ("prbs", {}),
    "prbs_200": ("prbs", {"frequency": 200.0}),
    "square_20": ("square", {"frequency": 20.0}),
}

DESIGNS: dict[str, tuple[str, dict[str, Any]]] = {
    "square": ("square", {"duration": 2.0}),
    "multisine_1000": ("multisine", {"frequency_end": 1000.0, "duration": 2.0}),
    "multisine_400": ("multisine", {"duration": LONG}),
    "multisine_400_in_turn": ("multisine", {"axes": "in_turn", "duration": 2.0}),
    "prbs": ("prbs", {"duration": 2.0}),
}

CREST_FACTORS: dict[str, tuple[dict[str, Any], bool]] = {
    "from_schroeder": ({"phasing": "schroeder", "interleaved": True}, True),
    "random": ({"interleaved": True}, False),
    "schroeder": ({"phasing": "schroeder", "interleaved": True}, False),
    "from_random": (BOTH_OPTIMISED, False),
}
"""Fields of the multisines of 11 to 400 Hz, and whether Schroeder's phases are optimised."""


class SlowPoint(Figures):
    """An amplitude on the slow amplifier: shares of the samples and of the linear response (-)."""

    amplitude_um: float
    region: str
    slewed: float
    duty_at_limit: float
    deviation: float
    distortion: float
    fit: float


class Designed(Figures):
    """A design: its worst values over the axes and seeds (-), and what limits it."""

    amplitude_um: float
    deviation: float
    distortion: float | None
    distortion_at_most: float | None
    fit: float
    limited_by: str
    trials: int


class Slow(Figures):
    """The slow amplifier: amplitudes, the largest one by the map, the design, and its fit with other seeds (-)."""

    points: list[SlowPoint]
    map_um: float
    design: Designed
    new_seeds: int
    fit_of_new_seeds: float


class Point(Figures):
    """A signal of one amplitude: shares of its power in A to D, loads, and regions by map, classifier and trial."""

    amplitude_um: float
    shares: list[float]
    load: float
    load_towards_d: float
    predicted: str
    classified: str
    bias_um: float | None
    region: str


class Verdicts(Figures):
    """Whether predictions that a signal stays in A, or leaves it, are right; loads of those that are wrong."""

    signals: int
    right: int
    left_open: int
    wrong_loads: list[float]
    right_by_shares: int
    a_by_shares_but_not: int


class Largest(Figures):
    """The largest amplitude in A by the map, by trials and by the classifier alone."""

    map_um: float
    trial_um: float
    ratio: float
    first_region: str
    classifier_um: float


class CrestFactor(Figures):
    """Crest factor of a multisine, and the largest one in A by trials."""

    crest_factor: float
    peak_um: float
    rms_um: float


class Excitation(Figures):
    """All of it."""

    map_sweeps: int
    slow: Slow
    signals: dict[str, list[Point]]
    verdicts: Verdicts
    largest: dict[str, Largest]
    designs: dict[str, Designed]
    crest_factors: dict[str, CrestFactor]


SMALLEST: dict[str, Any] = {
    "scale": 0.1,
    "map_settings": {"max_sweeps": 2, "frequency_end": 400.0, "duration": 0.2, "rest": 0.2},
    "amplitudes": 1,
    "signals": 1,
    "tolerance": 1.0,
}


def measure(
    scale: float = 1.0,
    map_settings: Mapping[str, Any] | None = None,
    amplitudes: int = 5,
    signals: int | None = None,
    tolerance: float = 0.02,
) -> dict[str, object]:
    """Everything that the page tells.

    Parameters
    ----------
    scale : float
        Factor on the durations of the signals and of the rest before them.
    map_settings : mapping, optional
        Settings of the maps; by default those of `amb map`, and fewer sweeps for the slow amplifier.
    amplitudes : int
        Number of amplitudes of a signal, the highest ones.
    signals : int or None
        Number of signals of each search, design and crest factor; None for all.
    tolerance : float
        Relative error of designs; that of the largest amplitudes is twice as large, that of crest factors half of it.
    """
    paper, slow = (replace(loop, rest=scale * loop.rest) for loop in (Loop(), SLOW))
    paper_map = _map(paper, map_settings or {})
    slow_map = _map(slow, map_settings or {"initial_sweeps": SLOW_SWEEPS, "max_sweeps": SLOW_SWEEPS})

    def case(kind: str, values: Mapping[str, Any], **options: Any) -> Case:
        duration = scale * values.get("duration", LONG)
        return Case(kind, {**values, "duration": duration}, loop=paper, region_map=paper_map, **options)

    on_map = {
        (name, amplitude): case(kind, values, amplitude=1e-6 * amplitude)
        for name, (kind, values, tried) in SIGNALS.items()
        for amplitude in tried[-amplitudes:]
    }
    searched = {name: case(*one, tolerance=2.0 * tolerance) for name, one in _first(LARGEST, signals)}
    designs = {name: case(*one, tolerance=tolerance) for name, one in _first(DESIGNS, signals)}
    multisines = {
        name: case("multisine", values, amplitude=20e-6, tolerance=0.5 * tolerance, from_schroeder=optimised)
        for name, (values, optimised) in _first(CREST_FACTORS, signals)
    }
    slow_case = Case(
        "multisine", {**SLOW_SIGNAL, "duration": scale * SLOW_LONG}, loop=slow, region_map=slow_map, tolerance=tolerance
    )
    points = _spread(on_map_and_in_trial, on_map)
    return {
        "map_sweeps": len(paper_map.sweeps),
        "slow": _slow(slow_case, SLOW_AMPLITUDES[:amplitudes]),
        "signals": {name: [point for key, point in points.items() if key[0] == name] for name in SIGNALS},
        "verdicts": _verdicts(list(points.values())),
        "largest": _spread(largest_in_a, searched),
        "designs": _spread(designed, designs),
        "crest_factors": _spread(crest_factor, multisines),
    }


def _map(loop: Loop, settings: Mapping[str, Any]) -> RegionMap:
    """The map of a loop, as `build_map` makes it, but without sweeps that are kept of earlier maps."""
    job = MapJob(validate(MapSettings, settings), loop.plant, loop.controller)
    wanted = job.refinement.amplitudes
    while wanted:
        sweeps = spread(run_sweep, [job.task(amplitude) for amplitude in wanted])
        wanted = [amplitude for sweep in sweeps for amplitude in job.refinement.add(sweep)]
    return job.map()


def _slow(case: Case, amplitudes: Sequence[float]) -> dict[str, object]:
    """The slow amplifier at amplitudes (um), its design, and other seeds at the designed amplitude."""
    points = spread(beyond_the_voltage, [replace(case, amplitude=1e-6 * amplitude) for amplitude in amplitudes])
    design = designed(case)
    return {
        "points": points,
        "map_um": UM * case.amplitude * case.checked().map_margin,
        "design": design,
        "new_seeds": NEW_SEEDS,
        "fit_of_new_seeds": fit_of_new_seeds(replace(case, amplitude=design["amplitude_um"] / UM), NEW_SEEDS),
    }


def _verdicts(points: Sequence[Mapping[str, Any]]) -> dict[str, object]:
    """Predictions that a signal stays in A or leaves it, against the trials."""
    stays = [point["region"] == Region.A.name for point in points]
    certain = [point["predicted"] in Region.__members__ for point in points]
    right = [(point["predicted"] == Region.A.name) == stay for point, stay in zip(points, stays, strict=True)]
    by_shares = [point["shares"][Region.A] > WHOLE for point in points]
    return {
        "signals": len(points),
        "right": sum(known and one for known, one in zip(certain, right, strict=True)),
        "left_open": len(points) - sum(certain),
        "wrong_loads": [
            point["load"] for point, known, one in zip(points, certain, right, strict=True) if known and not one
        ],
        "right_by_shares": sum(one == stay for one, stay in zip(by_shares, stays, strict=True)),
        "a_by_shares_but_not": sum(one and not stay for one, stay in zip(by_shares, stays, strict=True)),
    }


def _first(named: Mapping[str, Any], count: int | None) -> list[tuple[str, Any]]:
    return list(named.items())[:count]


def _spread(run: Callable[[Case], dict[str, Any]], cases: Mapping[Key, Case]) -> dict[Key, dict[str, Any]]:
    """The outcomes of cases by name."""
    return dict(zip(cases, spread(run, cases.values()), strict=True))
