"""The demo reaches its numbers (the paper's main experiment, in full length)."""

import json

import numpy as np
import pytest

from amb_bringup.client import NODES
from amb_bringup.demos.demo import run_demo
from amb_bringup.graph.packages import share_folder
from amb_core.identification import StateSpaceModel
from amb_core.recording import Recording


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_demo_reaches_its_numbers_and_leaves_its_results(tmp_path, domain):
    parameter_file = share_folder("amb_bringup") / "config" / "paper.yaml"
    names: set[str] = set()
    summary = run_demo(tmp_path, parameter_file, domain, lambda name, _done, _total: names.add(name))
    assert summary.bit_identical
    assert summary.processes == 6
    assert summary.closed_loop_natural_hz == pytest.approx(63.0, abs=3.0)
    assert summary.damping_ratio == pytest.approx(0.51, abs=0.06)
    assert summary.sag_um == pytest.approx(66.0, abs=4.0)
    assert summary.order == 10
    assert summary.fit_x >= 98.0
    assert summary.fit_y >= 96.5
    assert summary.unstable_poles == 2
    assert json.loads((tmp_path / "summary.json").read_text())["steps"] == summary.steps == 42_000
    assert StateSpaceModel.load(tmp_path / "model.json").order == 10
    bag = Recording.read(tmp_path / "bag")
    assert not bag.truncated
    assert set(bag.parameters()) >= {f"/amb/{name}" for name in NODES}
    recorded = bag.model()
    assert recorded is not None
    np.testing.assert_array_equal(recorded.a, StateSpaceModel.load(tmp_path / "model.json").a)
    assert (tmp_path / "orbit.png").stat().st_size > 10_000
    assert (tmp_path / "response.png").stat().st_size > 10_000
    assert {"small step", "square waves", "identification, pem", "figures"} <= names
