"""`amb map`: where its results go, and what happens when they cannot go there."""

from __future__ import annotations

import json
import resource

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import RegionError
from amb_core.ground.tasks import pool
from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSweep, RegionMap
from amb_core.regions.region_map.dwell_run import Dwell, DwellTask
from tests.waiting_pool import WaitingPool

STEEL = "H,B\n0,0\n100,0.8\n1000,1.4\n20000,1.9\n"


class Pool(WaitingPool):
    """Answers at once: sweeps fall at 400 Hz, those of another duration at 300 Hz, fixed sines at 900 Hz."""

    def next_finished(self, timeout):
        key, task = self._waiting.popleft()
        if isinstance(task, DwellTask):
            return key, Dwell(task.frequency, Region.D if task.frequency >= 900.0 else Region.A, True, 0.0, 1000)
        frequency = 400.0 if task.sweep.duration == 20.0 else 300.0
        return key, MapSweep(task.sweep.amplitude, {Region.D: Boundary(frequency, False)}, (), frequency, 1000)


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
    (cell,) = json.loads((out / "summary.json").read_text())["maps"]
    assert cell["values"]["iron.bh_table"] == str(table)
    assert len(RegionMap.load(out / cell["map"]).sweeps) == 3


def test_a_confirmed_map_reports_its_bands_its_rate_and_what_moves_with_it(amb_map, tmp_path):
    out = tmp_path / "out"
    done = amb_map("--confirm", "--out", out)
    assert done.exit_code == 0, done.output
    summary = json.loads((out / "summary.json").read_text())
    assert summary["sweep_rate"] == "249.5 Hz/s"
    confirmation = summary["confirmation"]
    assert confirmation["other_sweep_rate"] == "124.8 Hz/s"
    (spread,) = confirmation["dwell_over_sweep"]
    assert (spread["region"], spread["amplitudes"]) == ("D", 3)
    assert spread["median_ratio"] == pytest.approx(900.0 / 400.0, rel=0.03)
    assert confirmation["bands"][0]["boundaries"]["D"]["dwell_below"]["low"] < 900.0
    of_rate, of_fixed_sines = confirmation["warnings"]
    assert of_rate.startswith("D depends on the rate of the sweeps")
    assert of_fixed_sines.startswith("D differs under fixed sines")
    for text in (of_rate, of_fixed_sines, "rate of the sweeps: 249.5 Hz/s", "How far they lie apart"):
        assert text in " ".join(done.output.split())
    saved = RegionMap.load(out / "map.json").confirmation
    assert saved is not None
    assert saved.complete


def test_a_map_without_confirmation_reports_its_rate_only(amb_map, tmp_path):
    out = tmp_path / "out"
    assert amb_map("--duration", "10", "--out", out).exit_code == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["sweep_rate"] == "499 Hz/s"
    assert "confirmation" not in summary


def test_options_of_the_confirmation_need_it(amb_map, tmp_path):
    with pytest.raises(RegionError, match="--dwell, --rate-factor: allowed with --confirm only"):
        amb_map("--dwell", "2", "--rate-factor", "0.1", "--out", tmp_path)
    with pytest.raises(RegionError, match="--confirm is not available with --grid"):
        amb_map("--confirm", "--grid", "rotor.gravity=0", "--out", tmp_path)
