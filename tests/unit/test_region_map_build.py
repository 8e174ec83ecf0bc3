"""Building a map: what is run, what is reused, what is refused, and what a real cluster does."""

from __future__ import annotations

import logging
import threading

import pytest

from amb_core.ground.errors import ParameterError, PlantError, RegionError, TaskError
from amb_core.ground.parameters import validate
from amb_core.ground.tasks import cluster, pool
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, build_grid, build_map
from tests.waiting_pool import WaitingPool

SHORT = MapSettings(
    amplitude_low=20e-6,
    amplitude_high=80e-6,
    frequency_start=50.0,
    frequency_end=1000.0,
    duration=0.3,
    rest=0.1,
    initial_sweeps=3,
    max_sweeps=5,
)
LOOP = (PlantParameters(), ControllerParameters())


class Pool(WaitingPool):
    """Answers at once, last sweep first, with a boundary that jumps at 50 um."""

    ran: list[float]

    def next_finished(self, timeout):
        key, task = self._waiting.pop()
        amplitude = task.sweep.amplitude
        self.ran.append(amplitude)
        if task.plant.rotor.mass == 1.0 and amplitude > 70e-6:
            return key, TaskError("the loop does not hold it")
        frequency = 60.0 if amplitude > 50e-6 else 400.0
        return key, MapSweep(amplitude, {Region.D: Boundary(frequency, False)}, (), frequency, 1000)


@pytest.fixture
def ran(monkeypatch):
    monkeypatch.setattr(pool, "TaskPool", Pool)
    Pool.ran = []
    return Pool.ran


def test_finished_sweeps_are_not_run_again(ran, tmp_path):
    seen = []
    first = build_map(SHORT, *LOOP, cache=tmp_path, progress=seen.append)
    assert len(ran) == len(first.sweeps) == 5
    assert [(p.done, p.reused) for p in seen] == [(n, 0) for n in range(6)]
    assert seen[0].map is None
    assert seen[-1].map == first
    assert seen[-1].total == 5
    ran.clear()
    again = build_map(SHORT, *LOOP, cache=tmp_path, progress=seen.append)
    assert ran == []
    assert again == first
    assert seen[-1].reused == 5


def test_damaged_and_missing_entries_alone_are_run_again(ran, tmp_path, caplog):
    first = build_map(SHORT, *LOOP, cache=tmp_path)
    damaged, missing, *_ = sorted(tmp_path.iterdir())
    damaged.write_text("x")
    missing.unlink()
    ran.clear()
    with caplog.at_level(logging.WARNING):
        assert build_map(SHORT, *LOOP, cache=tmp_path) == first
    assert len(ran) == 2
    assert "damaged" in caplog.text
    ran.clear()
    assert build_map(SHORT, *LOOP, cache=tmp_path) == first
    assert ran == [], "a damaged entry was kept"


def test_a_disk_that_keeps_nothing_costs_a_warning_but_no_result(ran, tmp_path, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert len(build_map(SHORT, *LOOP, cache=blocked / "cache").sweeps) == 5
    assert caplog.text.count("cannot be kept") == 1


def test_a_cancelled_map_has_the_sweeps_that_finished(ran, tmp_path):
    region_map = build_map(SHORT, *LOOP, cache=tmp_path, cancelled=lambda: len(ran) >= 2)
    assert len(region_map.sweeps) == 2
    assert not region_map.complete
    with pytest.raises(RegionError, match="cancelled before its first sweep"):
        build_map(SHORT, *LOOP, cache=tmp_path / "other", cancelled=lambda: True)


def test_a_map_is_complete_when_its_boundaries_are_resolved(ran, tmp_path):
    assert build_map(SHORT.model_copy(update={"max_sweeps": 20}), *LOOP, cache=tmp_path).complete
    assert not build_map(SHORT, *LOOP, cache=tmp_path).complete


def test_the_provenance_tells_how_to_repeat_the_map(ran, tmp_path):
    provenance = build_map(SHORT, *LOOP, cache=tmp_path).provenance
    assert PlantParameters.model_validate(provenance["plant"]) == LOOP[0]
    assert ControllerParameters.model_validate(provenance["controller"]) == LOOP[1]
    assert len(provenance["code"]) == 64


def test_a_sweep_that_fails_ends_the_map_with_its_amplitude(ran, tmp_path):
    plant = validate(PlantParameters, {"rotor.mass": 1.0})
    with pytest.raises(RegionError, match="sweep of 8e-05 m: the loop does not hold it"):
        build_map(SHORT, plant, LOOP[1], cache=tmp_path)


def test_in_a_grid_a_map_that_fails_leaves_the_others(ran, tmp_path):
    design = {"rotor.mass": [1.0, 6.25], "controller.derivative_gain": [38.0, 2e4]}
    held_not, refused, good, _ = build_grid(SHORT, *LOOP, design, cache=tmp_path)
    assert (held_not.map, refused.map) == (None, None)
    assert "does not hold" in held_not.problem
    assert "derivative_gain" in refused.problem
    assert good.values == {"rotor.mass": 6.25, "controller.derivative_gain": 38.0}
    assert good.map == build_map(SHORT, *LOOP, cache=tmp_path)


def test_equal_maps_of_a_grid_run_their_sweeps_once(ran, tmp_path):
    one, other = build_grid(SHORT, *LOOP, {"controller.current_limit": [3.0, 3.0]}, cache=tmp_path)
    assert one.map == other.map
    assert len(ran) == 5


@pytest.mark.parametrize(
    ("design", "message"),
    [
        ({}, "at least one design parameter"),
        ({"bias_current": [1.0]}, "unknown design parameter 'bias_current'"),
        ({"derivative_gain": [1.0]}, r"that of the controller is 'controller\.derivative_gain'"),
        ({"rotor.gravity": []}, r"'rotor\.gravity' has no value"),
        ({"amplifier.bias_current": [11.0]}, "none of the 1 maps .* bias_current = 11 A must not exceed"),
    ],
)
def test_a_grid_that_makes_no_sense_is_refused(ran, design, message):
    with pytest.raises(RegionError, match=message):
        build_grid(SHORT, *LOOP, design)


@pytest.mark.parametrize(
    ("settings", "plant", "message"),
    [
        ({"frequency_end": 6000.0}, {}, r"frequency_end = 6000 Hz is above the Nyquist .* allowed: up to 5000 Hz"),
        ({"amplitude_high": 260e-6}, {}, r"amplitude_high = 0\.00026 m .* clearance of 0\.00025 m .* below 0\.00025 m"),
        ({"amplitude_high": 200e-6, "axes": "both"}, {}, r"45 degrees with both axes; allowed: below 0\.000176777 m"),
        ({"axes": "x"}, {"magnetic_circuit.actuators": "top_coil"}, r"'top_coil', which pull along y only; allowed: y"),
        (
            {"axes": "in_turn"},
            {},
            "'in_turn' is not allowed here; allowed: axes excited at the same time",
        ),
        ({"axes": "z"}, {}, "axes = 'z' is not allowed; allowed: x, y, .*, translate_y, all, both$"),
        ({"axes": "y_c"}, {"rotor.model": "rigid"}, "axes = 'y_c' is not allowed; .*allowed: x_a, y_a, x_b, y_b"),
        ({}, {"integration.sample_rate": 20e3}, "runs at 10000 Hz, the plant is sampled at 20000 Hz"),
    ],
)
def test_settings_that_do_not_fit_the_loop_are_refused_before_anything_runs(ran, settings, plant, message):
    with pytest.raises((RegionError, ParameterError), match=message):
        build_map(SHORT.model_copy(update=settings), validate(PlantParameters, plant), LOOP[1])
    assert ran == []


def test_a_plant_that_cannot_be_built_is_refused_before_anything_runs(ran):
    with pytest.raises(PlantError, match="nowhere"):
        build_map(SHORT, validate(PlantParameters, {"iron.saturation": True, "iron.bh_table": "/nowhere"}), LOOP[1])
    assert ran == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scheduler": "tcp://127.0.0.1:9"}, r"scheduler tcp://127\.0\.0\.1:9 does not answer within 0\.5 s"),
        ({"scheduler": "localhost"}, "'localhost' is no address; allowed: one like tls://host:8786"),
        ({"workers": 0}, "workers = 0 is not allowed"),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:9"}, "which has its own workers"),
    ],
)
def test_a_cluster_that_is_not_there_is_told_at_once(monkeypatch, tmp_path, options, message):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.5)
    with pytest.raises(TaskError, match=message):
        build_map(SHORT, *LOOP, cache=tmp_path, **options)


def test_a_map_can_be_built_from_any_thread(tmp_path):
    """As the action of the region monitor does, on a cluster of one process."""
    maps = []
    builder = threading.Thread(target=lambda: maps.append(build_map(SHORT, *LOOP, cache=tmp_path, workers=1)))
    builder.start()
    builder.join()
    assert len(maps[0].sweeps) == len(list(tmp_path.iterdir())) == 5
    assert all(sweep.boundaries for sweep in maps[0].sweeps[-2:])
