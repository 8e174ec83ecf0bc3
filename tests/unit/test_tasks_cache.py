"""Results on disk: what makes two tasks the same, and what happens when the disk fails."""

from __future__ import annotations

import json
import logging
import math
import resource
from pathlib import Path

import pytest

from amb_controller_node.parameters import PdControllerParameters
from amb_core.ground.errors import TaskError
from amb_core.ground.parameters import validate
from amb_core.ground.tasks import ResultCache, cache_folder
from amb_core.ground.tasks.cache import compute
from amb_core.ground.tasks.provenance import code_version
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep
from amb_core.regions.region_map.sweep_run import SweepTask
from amb_core.regions.subharmonics import SubharmonicSettings
from amb_core.regions.subharmonics.point import PointTask, SurfacePoint
from amb_sim_node.parameters import SimulatorParameters

SWEEP = MapSweep(20e-6, {Region.B: Boundary(300.0, False)}, ((1240.0, 1260.0),), 900.0, 1234)


def task(sweep=None, rest=0.1, plant=None, controller=None, regions=None):
    return SweepTask(
        sweep or MapSettings().sweep(20e-6),
        rest,
        plant or PlantParameters(),
        controller or ControllerParameters(),
        regions or RegionParameters(),
    )


def test_every_parameter_makes_another_key():
    others = [
        task(MapSettings().sweep(21e-6)),
        task(MapSettings(frequency_end=4000.0).sweep(20e-6)),
        task(MapSettings(axes="both").sweep(20e-6)),
        task(rest=0.2),
        task(plant=validate(PlantParameters, {"rotor.gravity": 0.0})),
        task(plant=validate(PlantParameters, {"sensor.noise_seed": 1})),
        task(controller=ControllerParameters(derivative_gain=37.0)),
        task(regions=RegionParameters(drift_threshold=3e-6)),
    ]
    keys = {one.key() for one in others} | {task().key()}
    assert len(keys) == len(others) + 1
    assert task().key() == task().key()


def test_the_classifier_of_a_sweep_knows_the_running_speed_of_the_plant_in_its_own_unit():
    turning = validate(PlantParameters, {"rotor.running_speed": 25.0})  # Hz
    assert task(plant=turning).regions.running_speed == pytest.approx(2.0 * math.pi * 25.0)  # rad/s
    assert task(plant=turning, regions=RegionParameters(running_speed=3.0)).regions.running_speed == 3.0
    assert task().regions.running_speed == 0.0


def test_parameters_of_nodes_have_the_keys_of_what_they_describe():
    node = task(plant=SimulatorParameters(clock_period=0.5), controller=PdControllerParameters(telemetry_block=7))
    assert node.key() == task().key()


def test_the_content_of_data_files_counts(tmp_path):
    table = tmp_path / "iron.csv"
    plant = validate(PlantParameters, {"iron.saturation": True, "iron.bh_table": str(table)})
    table.write_text("0, 0\n100, 1\n")
    before = task(plant=plant).key()
    table.write_text("0, 0\n100, 1.1\n")
    assert task(plant=plant).key() != before


@pytest.mark.parametrize("changed", ["__init__.py", "deep/kernel.py"])
def test_every_module_of_a_package_counts_for_its_version(changed, tmp_path, monkeypatch):
    name = f"library_{tmp_path.name}"
    package = tmp_path / name
    (package / "deep").mkdir(parents=True)
    for file in ("__init__.py", "deep/kernel.py"):
        (package / file).write_text("STEP = 1")
    monkeypatch.syspath_prepend(tmp_path)
    before = code_version.__wrapped__(name)
    assert code_version.__wrapped__(name) == before
    (package / changed).write_text("STEP = 2")
    assert code_version.__wrapped__(name) != before


@pytest.mark.parametrize("asked", [task(), PointTask(PlantParameters(), ControllerParameters(), SubharmonicSettings())])
def test_a_task_depends_on_the_whole_library(asked):
    assert asked.describe()["code"] == code_version("amb_core")


def test_a_point_of_a_surface_is_found_again_as_it_was(tmp_path):
    nan = float("nan")
    point = SurfacePoint("delevitated", nan, 1e-7, 0.1 + 0.2, nan, "", -0.0)
    asked = PointTask(PlantParameters(), ControllerParameters(), SubharmonicSettings())
    cache = ResultCache(tmp_path)
    cache.store("k", asked, point)
    assert repr(cache.load("k", asked)) == repr(point)


def test_every_parameter_makes_another_point():
    test, loop = SubharmonicSettings(), (PlantParameters(), ControllerParameters())
    nodes = SimulatorParameters(clock_period=0.5), PdControllerParameters(telemetry_block=7)
    others = [
        PointTask(*loop, test.changed(inducing_amplitude=41e-6)),
        PointTask(*loop, test.changed(line_tolerance=1e-8)),
        PointTask(validate(PlantParameters, {"rotor.gravity": 0.0}), loop[1], test),
        PointTask(loop[0], ControllerParameters(derivative_gain=37.0), test),
    ]
    assert len({one.key() for one in others} | {PointTask(*loop, test).key()}) == len(others) + 1
    assert PointTask(*nodes, test).key() == PointTask(loop[0], nodes[1], test).key()


def test_what_is_stored_is_found_again(tmp_path):
    cache = ResultCache(tmp_path / "new" / "folder")
    assert cache.load("k", task()) is None
    cache.store("k", task(), SWEEP)
    assert cache.load("k", task()) == SWEEP
    assert [path.name for path in cache.folder.iterdir()] == ["k.json"]
    assert json.loads(cache.path("k").read_text())["task"]["controller"]["proportional_gain"] == 20_000.0


def damage_checksum(text):
    return text.replace("300.0", "301.0")


def damage_half(text):
    return text[: len(text) // 2]


@pytest.mark.parametrize("damage", [damage_checksum, damage_half, lambda _: "", lambda _: "[]", lambda _: "\udcff"])
def test_a_damaged_entry_is_as_none_but_for_a_warning(tmp_path, caplog, damage):
    cache = ResultCache(tmp_path)
    cache.store("k", task(), SWEEP)
    path = cache.path("k")
    path.write_text(damage(path.read_text()), errors="surrogateescape")
    with caplog.at_level(logging.WARNING):
        assert cache.load("k", task()) is None
    assert "k.json is damaged" in caplog.text
    assert "computed again" in caplog.text
    cache.store("k", task(), SWEEP)
    assert cache.load("k", task()) == SWEEP


def test_a_folder_that_cannot_be_made_costs_one_warning(tmp_path, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("")
    cache = ResultCache(blocked / "folder")
    with caplog.at_level(logging.WARNING):
        cache.ensure("k", task(), SWEEP)
        cache.ensure("l", task(), SWEEP)
    assert caplog.text.count("cannot be kept") == 1
    assert "Not a directory" in caplog.text


def test_a_full_disk_costs_a_warning_and_leaves_no_half_file(tmp_path, caplog):
    """The limit on the size of files stops the write half-way, as a full disk does."""
    cache, described = ResultCache(tmp_path), task()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        cache.ensure("k", described, SWEEP)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "cannot be kept" in caplog.text
    assert "File too large" in caplog.text
    assert list(tmp_path.iterdir()) == []


def test_a_worker_with_other_code_refuses(tmp_path):
    with pytest.raises(TaskError, match="another version"):
        compute(task(), "0" * 64, tmp_path)


def test_results_are_kept_in_the_cache_folder_of_the_user(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder("region_map") == Path("/somewhere/amb/region_map")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder("region_map") == Path.home() / ".cache/amb/region_map"
