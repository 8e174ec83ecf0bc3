"""The demo of the rig: four axes over topics, one 4x4 model, compared with the linearised plant."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from amb_bringup.demos.machine_demo import run_machine_demo
from amb_bringup.graph.packages import share_folder
from amb_core.recording import Recording


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("running_speed", [0.0, 100.0], ids=["at rest", "6000 r/min"])
def test_the_rig_is_identified_on_four_axes(tmp_path: Path, domain: int, running_speed: float) -> None:
    parameters = tmp_path / "rig.yaml"
    rig = (share_folder("amb_bringup") / "config" / "rig.yaml").read_text()
    parameters.write_text(rig.replace("model: rigid\n", f"model: rigid\n      running_speed: {running_speed}\n"))

    summary = run_machine_demo(tmp_path / "out", parameters, domain, lambda _name, _done, _total: None)

    assert summary.axes == ["x_a", "y_a", "x_b", "y_b"]
    assert summary.bit_identical
    assert summary.unstable_poles == summary.unstable_poles_computed == 4
    assert min(summary.fit.values()) >= 98.0
    assert summary.modes_missing == 0
    rigid = {"precession", "nutation"} if running_speed else {"tilt"}
    assert {mode["kind"] for mode in summary.modes} == {"translation", *rigid}
    assert max(abs(mode["frequency_error_percent"]) for mode in summary.modes) <= 1.0
    assert summary.frf_error_percent <= 3.0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["fit"] == summary.fit
    assert Recording.read(tmp_path / "out" / "bag").machine().axis_names == tuple(summary.axes)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_bending_of_the_flexible_rotor_is_identified(tmp_path: Path, domain: int) -> None:
    parameters = share_folder("amb_bringup") / "config" / "flexible.yaml"

    summary = run_machine_demo(tmp_path / "out", parameters, domain, lambda _name, _done, _total: None)

    assert summary.bit_identical
    assert summary.unstable_poles == summary.unstable_poles_computed == 4
    assert min(summary.fit.values()) >= 98.0
    assert summary.modes_missing == 0
    bending = [abs(mode["frequency_error_percent"]) for mode in summary.modes if mode["kind"] == "bending"]
    assert len(bending) == 4  # two bending modes in two planes
    assert max(bending) <= 0.5
    assert summary.frf_error_percent <= 3.0
