"""`amb map`: where its results go, and what happens when they cannot go there."""

from __future__ import annotations

import json
import resource

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.errors import RegionError
from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSweep, RegionMap
from amb_core.tasks import pool

STEEL = "H,B\n0,0\n100,0.8\n1000,1.4\n20000,1.9\n"


class Pool:
    """Answers every sweep at once with the same boundary."""

    def __class_getitem__(cls, result):
        return cls

    def __init__(self, scheduler, workers):
        self._waiting = []

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        pass

    def submit(self, task, key, folder, priority):
        self._waiting.append((key, task.sweep.amplitude))

    def next_finished(self, timeout):
        key, amplitude = self._waiting.pop(0)
        return key, MapSweep(amplitude, {Region.D: Boundary(400.0, False)}, (), 400.0, 1000)


@pytest.fixture
def amb_map(monkeypatch, tmp_path):
    monkeypatch.setattr(pool, "TaskPool", Pool)

    def run(*options):
        words = ["map", "--initial-sweeps", 3, "--max-sweeps", 3, "--cache", tmp_path / "cache", *options]
        return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)

    return run


def test_a_map_that_cannot_be_written_leaves_the_one_that_is_there(amb_map, tmp_path):
    """The limit on the size of files stops the write half-way, as a full disk does."""
    out = tmp_path / "out"
    assert amb_map("--out", out).exit_code == 0
    before = (out / "map.json").read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(RegionError, match=r"map\.json: cannot be written: File too large"):
            amb_map("--out", out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (out / "map.json").read_bytes() == before
    assert not list(out.glob("*.part"))


def test_a_grid_over_files_has_a_folder_for_each(amb_map, tmp_path):
    table, out = tmp_path / "steel.csv", tmp_path / "out"
    table.write_text(STEEL)
    assert amb_map("--out", out, "--grid", "iron.saturation=true", "--grid", f"iron.bh_table={table}").exit_code == 0
    (cell,) = json.loads((out / "summary.json").read_text())
    assert cell["values"]["iron.bh_table"] == str(table)
    assert len(RegionMap.load(out / cell["map"]).sweeps) == 3
