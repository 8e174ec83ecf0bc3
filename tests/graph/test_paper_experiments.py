"""Experiments of the paper through the graph equal those without ROS; their bags are kept, or recorded again."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_core.excitation import Square
from amb_paper.graph_experiment import GraphExperiment, equality_claim
from amb_paper.studies.concurrent_sweep import ConcurrentSweep
from amb_paper.studies.square_waves import SquareWaves
from amb_paper.study import Study, Workplace


@pytest.mark.slow
def test_a_damaged_bag_is_recorded_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, domain: int) -> None:
    experiment = GraphExperiment("squares", Square(amplitude=5e-6, duration=0.1, frequency=50.0))
    expected = experiment.without_ros()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    recorded = experiment.through_ros(tmp_path, expected)
    assert equality_claim("squares", "Fig. 0", expected, recorded).verdict == "agrees"
    (bag,) = (tmp_path / "squares").glob("*.mcap")
    made = bag.stat().st_mtime_ns
    experiment.through_ros(tmp_path, expected)
    assert bag.stat().st_mtime_ns == made
    bag.write_bytes(bag.read_bytes()[:-100])
    assert not experiment.is_kept(tmp_path)
    again = experiment.through_ros(tmp_path, expected)
    assert again.record.identical_to(expected.record)
    assert experiment.is_kept(tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("study", [SquareWaves(), ConcurrentSweep()], ids=lambda study: study.name)
def test_a_study_through_the_graph_leaves_its_bag(
    study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, domain: int
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    result = study.run_at(Workplace(folder=tmp_path, cache=tmp_path))
    assert study.files_are_whole(tmp_path)
    verdicts = {claim.id: claim.verdict for claim in result.claims}
    assert all(verdict == "agrees" for name, verdict in verdicts.items() if name.endswith("-through-ros"))
    assert "does not agree" not in verdicts.values()
