"""Confirmation of a map: which dwells are run, what they say about the boundaries, and what is made of it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from amb_core.designs.excitation import check_excitation
from amb_core.excitation import excitation_from_request, generate
from amb_core.ground.errors import RegionError, TaskError
from amb_core.ground.parameters import validate
from amb_core.ground.tasks import pool
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import (
    Boundary,
    Confirmation,
    ConfirmationSettings,
    DwellBoundary,
    MapSettings,
    MapSweep,
    RegionMap,
    below_and_above,
    build_map,
    confirm_map,
    confirmation_warnings,
    sweep_and_dwell,
    two_rates,
)
from amb_core.regions.region_map.dwell_run import Dwell, DwellTask
from tests.waiting_pool import WaitingPool

LOOP = (PlantParameters(), ControllerParameters())
PAPER_MAP = Path(__file__).parent / "data" / "paper_map.json"
SETTINGS = MapSettings(initial_sweeps=3, max_sweeps=3, duration=20.0)


class Bearing(WaitingPool):
    """Answers tasks at once, last first: boundaries in closed form, with hysteresis and a dependence on the rate.

    B begins at 6 mHz m / a under fixed sines, and 10 % higher in sweeps of 20 s. D: sweeps fall at 800 Hz; fixed sines
    that come from below at 1000 Hz, those that start from rest at 2100 Hz.
    """

    ran: list[object]

    def next_finished(self, timeout):
        key, task = self._waiting.pop()
        self.ran.append(task)
        return key, self.dwell(task) if isinstance(task, DwellTask) else self.sweep(task)

    def drift(self, amplitude):
        return 6e-3 / amplitude

    def sweep(self, task):
        amplitude = task.sweep.amplitude
        if task.plant.rotor.mass == 1.0 and task.sweep.duration > 20.0:
            return TaskError("out of memory")
        drift = self.drift(amplitude) * (1.1 if task.sweep.duration == 20.0 else 1.3)
        boundaries = {Region.B: drift, Region.D: 800.0}
        within = {region: Boundary(at, False) for region, at in boundaries.items() if at <= 800.0}
        return MapSweep(amplitude, within, (), 800.0, 1000)

    def dwell(self, task):
        held = 2100.0 if task.start == task.frequency else 1000.0
        if task.start > 2100.0 or task.frequency >= held:
            return Dwell(task.frequency, Region.D, task.start <= 2100.0 or task.start == task.frequency, 0.0, 10)
        drifts = task.frequency >= self.drift(task.sweep.sweep.amplitude)
        return Dwell(task.frequency, Region.B if drifts else Region.A, True, 0.0, 1000)


@pytest.fixture
def ran(monkeypatch):
    monkeypatch.setattr(pool, "TaskPool", Bearing)
    Bearing.ran = []
    return Bearing.ran


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the finished sweeps and dwells of the map `confirmed`."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def confirmed_and_ran(cache: Path) -> tuple[RegionMap, list[object]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pool, "TaskPool", Bearing)
        Bearing.ran = []
        region_map = build_map(SETTINGS, *LOOP, cache=cache)
        return confirm_map(region_map, *LOOP, cache=cache), Bearing.ran


@pytest.fixture
def confirmed(confirmed_and_ran: tuple[RegionMap, list[object]]) -> RegionMap:
    return confirmed_and_ran[0]


# -- the dwells


def test_every_boundary_is_bracketed_to_the_resolution_of_the_map(confirmed: RegionMap) -> None:
    assert confirmed.confirmation is not None
    assert confirmed.confirmation.complete
    for amplitude in confirmed.amplitudes:
        dwell = confirmed.confirmation.dwell(Region.B, amplitude, "below")
        if dwell is not None:
            assert dwell.low < 6e-3 / amplitude <= dwell.high <= 1.031 * dwell.low


def test_both_directions_are_reported_where_they_differ(confirmed: RegionMap) -> None:
    """A rotor that starts from rest above the boundary of the sweeps holds up to 2100 Hz."""
    assert confirmed.confirmation is not None
    largest = confirmed.amplitudes[-1]
    below = confirmed.confirmation.dwell(Region.D, largest, "below")
    above = confirmed.confirmation.dwell(Region.D, largest, "above")
    assert below is not None
    assert above is not None
    assert below.frequency == pytest.approx(1000.0, rel=0.03)
    assert above.frequency == pytest.approx(2100.0, rel=0.03)
    (band,) = [band for band in below_and_above(confirmed) if band.region is Region.D]
    assert band.ratio[-1] == pytest.approx(2.1, rel=0.04)


def test_a_sine_from_below_starts_below_and_one_from_above_above(confirmed_and_ran) -> None:
    dwells = [task for task in confirmed_and_ran[1] if isinstance(task, DwellTask)]
    ratios = {round(task.frequency / task.start, 6) for task in dwells}
    assert {1.2, 1.0} <= ratios
    assert any(ratio < 1.0 for ratio in ratios)
    assert all(task.start <= 0.5 * LOOP[1].sample_rate for task in dwells)


def test_a_first_boundary_that_the_sweep_lacks_is_looked_for(confirmed: RegionMap) -> None:
    """At 5 um the drift would begin at 1200 Hz: sweeps fall at 800 Hz, fixed sines at 1000 Hz, so there is none."""
    assert Region.B not in confirmed.sweeps[0].boundaries
    assert confirmed.confirmation is not None
    bisected = {(one.region, one.direction) for one in confirmed.confirmation.dwells if one.amplitude == 5e-6}
    assert bisected == {(Region.D, "below"), (Region.D, "above")}


def test_a_direction_in_which_the_rotor_cannot_be_started_decides_nothing(ran, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(Bearing, "dwell", lambda self, task: _falls_at_its_start(task))
    region_map = build_map(SETTINGS, *LOOP, cache=tmp_path)
    confirmed = confirm_map(region_map, *LOOP, cache=tmp_path)
    largest = confirmed.amplitudes[-1]
    assert confirmed.confirmation is not None
    above = confirmed.confirmation.dwell(Region.B, largest, "above")
    assert above is not None
    assert not above.reached
    assert confirmed.boundary(Region.B, largest, "dwell") == pytest.approx(70.0, rel=0.03)


def _falls_at_its_start(task: DwellTask) -> Dwell:
    if task.start > 75.0:
        return Dwell(task.frequency, Region.D, task.start <= task.frequency, 0.0, 10)
    return Dwell(task.frequency, Region.A if task.frequency < 70.0 else Region.B, True, 0.0, 10)


def test_a_map_without_any_boundary_is_confirmed_at_its_highest_frequency(ran, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(Bearing, "sweep", lambda self, task: MapSweep(task.sweep.amplitude, {}, (), 5000.0, 1))
    monkeypatch.setattr(Bearing, "dwell", lambda self, task: Dwell(task.frequency, Region.A, True, 0.0, 10))
    confirmed = confirm_map(build_map(SETTINGS, *LOOP, cache=tmp_path), *LOOP, cache=tmp_path)
    assert confirmed.confirmation is not None
    assert all(math.isinf(one.frequency) for one in confirmed.confirmation.dwells)
    assert {task.frequency for task in ran if isinstance(task, DwellTask)} == {5000.0}
    assert math.isinf(confirmed.boundary(Region.B, 20e-6, "dwell"))


# -- kept, resumed, cancelled, failed


def test_finished_dwells_and_sweeps_are_not_run_again(confirmed: RegionMap, ran, cache) -> None:
    seen = []
    again = confirm_map(confirmed, *LOOP, cache=cache, progress=seen.append)
    assert ran == []
    assert again == confirmed
    assert seen[-1].done == seen[-1].total == seen[-1].reused
    assert seen[-1].map == confirmed


def test_a_cancelled_confirmation_has_what_finished_and_resumes(confirmed: RegionMap, ran, tmp_path) -> None:
    region_map = build_map(SETTINGS, *LOOP, cache=tmp_path)
    ran.clear()
    partial = confirm_map(region_map, *LOOP, cache=tmp_path, cancelled=lambda: len(ran) >= 15)
    assert partial.confirmation is not None
    assert not partial.confirmation.complete
    ran.clear()
    assert confirm_map(region_map, *LOOP, cache=tmp_path) == confirmed


def test_a_failure_ends_the_confirmation_with_its_amplitude(ran, tmp_path) -> None:
    plant = validate(PlantParameters, {"rotor.mass": 1.0})
    region_map = build_map(SETTINGS, plant, LOOP[1], cache=tmp_path)
    with pytest.raises(RegionError, match=r"sweep of .* m at another rate: out of memory"):
        confirm_map(region_map, plant, LOOP[1], cache=tmp_path)


# -- bands and warnings


def test_the_band_lies_between_sweep_and_fixed_sine(confirmed: RegionMap) -> None:
    bands = {band.region: band for band in sweep_and_dwell(confirmed)}
    assert bands[Region.B].ratio == pytest.approx(1.0 / 1.1, rel=0.03)
    assert bands[Region.D].ratio == pytest.approx(1000.0 / 800.0, rel=0.03)


def test_a_boundary_that_moves_with_the_rate_by_more_than_ten_percent_is_warned_of(confirmed: RegionMap) -> None:
    assert (
        "B depends on the rate of the sweeps: from 249.5 Hz/s to 124.8 Hz/s it moves by up to +18 % at 22.4, 100 um"
    ) in confirmation_warnings(confirmed)
    bands = {band.region: band for band in two_rates(confirmed)}
    assert bands[Region.B].moved == 2
    assert bands[Region.D].moved == 0


def test_a_boundary_that_lies_elsewhere_under_fixed_sines_is_warned_of(confirmed: RegionMap) -> None:
    """Sweeps of both rates fall at 800 Hz, fixed sines from below at 1000 Hz and those from rest at 2100 Hz."""
    of_d = [warning for warning in confirmation_warnings(confirmed) if warning.startswith("D ")]
    under_fixed_sines, by_direction = of_d
    assert under_fixed_sines.startswith(
        "D differs under fixed sines: from sweeps of 249.5 Hz/s to fixed sines it moves"
    )
    assert by_direction.startswith("D depends on the direction: from fixed sines from below to those from above it")
    assert under_fixed_sines.endswith("at 5, 22.4, 100 um")
    tone = generate(
        excitation_from_request("tones", {"frequencies": [50.0], "amplitudes": [10e-6], "axes": "y", "duration": 1.0}),
        LOOP[1].sample_rate,
    )
    assert set(of_d) <= set(check_excitation(tone, confirmed, LOOP[1], LOOP[0]).notes)


def test_a_region_that_fixed_sines_only_show_is_warned_of() -> None:
    """A bearing with a slow amplifier: sweeps of 60 um fall without a slow oscillation, fixed sines oscillate first."""
    sweep = MapSweep(6e-5, {Region.D: Boundary(355.0, False)}, (), 5e3, 1)
    dwells = tuple(
        DwellBoundary(6e-5, region, "below", low, high)
        for region, low, high in ((Region.C, 273.0, 280.0), (Region.D, 347.0, 355.0))
    )
    confirmation = Confirmation(ConfirmationSettings(), dwells, (sweep,), True)
    assert confirmation_warnings(RegionMap(MapSettings(), (sweep,), {}, True, confirmation)) == [
        "C differs under fixed sines: from sweeps of 249.5 Hz/s to fixed sines it appears at 60 um"
    ]


def test_a_region_that_one_rate_only_shows_is_warned_of() -> None:
    def sweep(amplitude: float, **at: float) -> MapSweep:
        return MapSweep(amplitude, {Region[name]: Boundary(f, False) for name, f in at.items()}, (), 5e3, 1)

    confirmation = Confirmation(ConfirmationSettings(), (), (sweep(1e-5, D=700.0), sweep(2e-5, B=95.0, D=350.0)), True)
    region_map = RegionMap(
        MapSettings(), (sweep(1e-5, B=200.0, D=700.0), sweep(2e-5, B=100.0, D=350.0)), {}, True, confirmation
    )
    assert confirmation_warnings(region_map) == [
        "B depends on the rate of the sweeps: from 249.5 Hz/s to 124.8 Hz/s it disappears at 10 um"
    ]


def test_the_rate_of_a_logarithmic_sweep_rises_with_the_frequency() -> None:
    settings = MapSettings(spacing="logarithmic", frequency_start=10.0, frequency_end=1000.0, duration=20.0)
    assert settings.sweep_rate(1000.0) == pytest.approx(100.0 * settings.sweep_rate(10.0))
    assert settings.at_rate(0.5).sweep_rate(100.0) == pytest.approx(0.5 * settings.sweep_rate(100.0))
    assert settings.at_rate(0.02).duration == 600.0, "longer sweeps are not allowed"


# -- sides of a map


def test_the_dwell_side_is_the_lower_direction(confirmed: RegionMap) -> None:
    largest = confirmed.amplitudes[-1]
    assert confirmed.boundary(Region.D, largest) == pytest.approx(800.0)
    assert confirmed.boundary(Region.D, largest, "dwell") == pytest.approx(1000.0, rel=0.03)
    assert confirmed.region_at(900.0, largest) == Region.D
    assert confirmed.region_at(900.0, largest, "dwell") == Region.B


def test_without_confirmation_both_sides_are_the_sweeps() -> None:
    region_map = RegionMap.load(PAPER_MAP)
    for region in (Region.B, Region.C, Region.D):
        assert region_map.boundary(region, region_map.amplitudes, "dwell") == pytest.approx(
            region_map.boundary(region, region_map.amplitudes), nan_ok=True
        )


def test_a_boundary_that_was_not_bisected_is_that_of_the_sweep(confirmed: RegionMap) -> None:
    assert confirmed.confirmation is not None
    largest = confirmed.amplitudes[-1]
    kept = tuple(one for one in confirmed.confirmation.dwells if one.region is Region.B)
    confirmation = Confirmation(confirmed.confirmation.settings, kept, (), False)
    region_map = RegionMap(confirmed.settings, confirmed.sweeps, {}, True, confirmation)
    assert region_map.boundary(Region.D, largest, "dwell") == pytest.approx(800.0)


def test_a_confirmed_map_survives_its_file(confirmed: RegionMap, tmp_path) -> None:
    confirmed.save(tmp_path / "map.json")
    assert RegionMap.load(tmp_path / "map.json") == confirmed
    content = json.loads((tmp_path / "map.json").read_text())
    assert content["format"] == 1, "files of earlier versions are read, and earlier versions read these"


def test_a_file_with_a_wrong_confirmation_is_refused_by_name(confirmed: RegionMap, tmp_path) -> None:
    path = tmp_path / "map.json"
    confirmed.save(path)
    content = json.loads(path.read_text())
    content["confirmation"]["dwells"][0]["direction"] = "sideways"
    path.write_text(json.dumps(content))
    with pytest.raises(RegionError, match=r"map\.json: is no region map .*sideways.* allowed: below, above"):
        RegionMap.load(path)


def test_excitations_are_checked_on_the_dwell_side() -> None:
    """A tone in region A by the sweeps, where a fixed sine of its amplitude drifts."""
    region_map = RegionMap.load(PAPER_MAP)
    dwells = tuple(
        DwellBoundary(
            sweep.amplitude,
            Region.B,
            "below",
            *(0.5 * factor * sweep.boundaries[Region.B].frequency for factor in (0.99, 1.01)),
        )
        for sweep in region_map.sweeps
        if Region.B in sweep.boundaries
    )
    confirmed = RegionMap(
        region_map.settings,
        region_map.sweeps,
        region_map.provenance,
        True,
        Confirmation(ConfirmationSettings(), dwells, (), True),
    )
    amplitude = 15e-6
    frequency = 0.7 * float(region_map.boundary(Region.B, amplitude))
    request = {"frequencies": [frequency], "amplitudes": [amplitude], "axes": "y", "duration": 2.0}
    tone = generate(excitation_from_request("tones", request), 10e3)
    assert check_excitation(tone, region_map).predicted is Region.A
    assert check_excitation(tone, confirmed).predicted is Region.B
