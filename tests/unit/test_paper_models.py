"""Verdicts on the identified models follow from what was found; bags that are not whole are known as such."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from amb_core.designs.excitation import Trial
from amb_core.excitation import Square
from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.arx import arx as identify_arx
from amb_core.identification.focus.sweep_error import SweepError, sweep_error
from amb_core.loop.records import LoopRecord
from amb_core.regions import Classification, Judged, Onset, Region
from amb_paper import graph_experiment
from amb_paper.graph_experiment import GraphExperiment, LoopRun, equality_claim
from amb_paper.model_trials import ModelTask, ModelTrial
from amb_paper.studies import arx, concurrent_sweep, multisine, square_waves
from amb_paper.studies.arx import LAGS, NOISES, SAME_ORDER, Transient

ALL_JUDGED = Judged({}, {}, 0.7)


def record(position: np.ndarray) -> LoopRecord:
    return LoopRecord(0, 1e-4, np.zeros_like(position), position, np.zeros_like(position))


def transients(short: float, long: float = 4e-6, pem: float = 4e-6) -> list[Transient]:
    """ARX of few lags errs by `short` in the noisiest data and like the others elsewhere."""
    trials = []
    for noise in NOISES:
        trials.append(Transient(noise, 0, 10, pem))
        for lags in LAGS:
            trials.append(Transient(noise, lags, 2 * lags, short if noise == NOISES[-1] else long))
    return trials


@pytest.mark.parametrize(("short", "verdict"), [(5e-6, "does not agree"), (50e-6, "agrees in part")])
def test_arx_counts_as_transient_where_it_errs_more_than_the_state_space_model(short: float, verdict: str) -> None:
    (claim,) = arx.claims(transients(short))
    assert claim.verdict == verdict
    assert f"{1e6 * short:.1f} µm" in claim.finding


def test_arx_agrees_where_it_errs_more_at_any_noise() -> None:
    (claim,) = arx.claims([replace(one, error=1.0 if one.lags == SAME_ORDER else 1e-6) for one in transients(1.0)])
    assert claim.verdict == "agrees"
    assert claim.reason == ""


def errors(first: float, last: float) -> SweepError:
    rising = np.column_stack([np.linspace(first, last, 4)] * 2)
    return SweepError(np.geomspace(11.0, 400.0, 5), 1e-6 * rising, 1e-6 * rising, rising)


def regions(*begun: Region) -> Classification:
    return Classification([], {region: Onset(0, 1.0, 100.0, False) for region in begun}, {"x": {}, "y": {}}, ALL_JUDGED)


@pytest.mark.parametrize(
    ("first", "last", "begun", "verdicts"),
    [
        (0.02, 1.0, (Region.B, Region.C), ["agrees", "agrees", "agrees"]),
        (0.02, 1.0, (Region.B, Region.D), ["agrees", "agrees", "agrees in part"]),
        (0.02, 1.0, (Region.C,), ["agrees", "agrees", "agrees in part"]),
        (0.2, 0.2, (), ["does not agree", "does not agree", "does not agree"]),
    ],
)
def test_a_sweep_is_judged_by_the_error_at_its_ends(
    first: float, last: float, begun: tuple[Region, ...], verdicts: list[str]
) -> None:
    told = concurrent_sweep.claims(errors(first, last), regions(*begun), 400.0, False)
    assert [claim.verdict for claim in told] == verdicts


def test_error_over_frequency_tells_bias_and_movement_apart() -> None:
    frequency = np.linspace(10.0, 100.0, 1_000)
    moved = 1e-6 * np.sin(np.arange(1_000.0))
    measured = record(np.column_stack([moved + 5e-6, 2.0 * moved]))
    error = sweep_error(measured, record(np.column_stack([moved, moved])), frequency, bands=4)
    np.testing.assert_allclose(error.mean[:, 0], 5e-6)
    np.testing.assert_allclose(error.movement[:, 0], 0.0, atol=1e-18)
    np.testing.assert_allclose(error.relative[:, 1], 0.5, rtol=0.01)


def test_error_over_frequency_refuses_bands_without_samples() -> None:
    some = record(np.zeros((10, 2)))
    with pytest.raises(IdentificationError, match="fewer than two samples; use fewer bands"):
        sweep_error(some, some, np.linspace(10.0, 100.0, 10), bands=10)
    with pytest.raises(IdentificationError, match="must have as many samples"):
        sweep_error(some, some, np.linspace(10.0, 100.0, 9))


def trials(stable: bool, fit: float) -> list[ModelTrial]:
    return [
        ModelTrial(data.name, "pem", order, 0.98 if stable or data is multisine.CONTROL else 1.02, one)
        for data in multisine.DATA
        for order in multisine.ORDERS
        for one in [95.0 if data is multisine.CONTROL else fit]
    ]


def regions_of_data(beyond: Region) -> dict[str, Region]:
    return {data.name: Region.A if data is multisine.CONTROL else beyond for data in multisine.DATA}


@pytest.mark.parametrize(
    ("stable", "beyond", "verdict"),
    [(False, Region.C, "agrees"), (True, Region.C, "does not agree"), (False, Region.A, "does not agree")],
)
def test_no_stable_model_is_judged_on_data_beyond_region_a(stable: bool, beyond: Region, verdict: str) -> None:
    claim = multisine.beyond_claim(trials(stable, 50.0), regions_of_data(beyond))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


def test_no_stable_model_agrees_in_part_only_where_a_whole_data_set_has_none() -> None:
    mixed = [trial if trial.order == 4 else replace(trial, radius=1.02) for trial in trials(True, 50.0)]
    assert multisine.beyond_claim(mixed, regions_of_data(Region.B)).verdict == "does not agree"
    barren = [replace(trial, radius=1.02) if trial.data == multisine.SWEPT.name else trial for trial in mixed]
    assert multisine.beyond_claim(barren, regions_of_data(Region.B)).verdict == "agrees in part"


@pytest.mark.parametrize(("fit", "verdict"), [(50.0, "agrees"), (97.0, "agrees in part")])
def test_the_control_must_be_better_than_data_beyond_region_a(fit: float, verdict: str) -> None:
    assert multisine.control_claim(trials(True, fit), regions_of_data(Region.B)).verdict == verdict


def test_without_data_beyond_region_a_nothing_shows_that_the_region_decides() -> None:
    claim = multisine.control_claim(trials(True, 95.0), regions_of_data(Region.A))
    assert claim.verdict == "agrees in part"


@pytest.mark.parametrize(
    ("begun", "verdict"),
    [
        ((Region.B, Region.C), "agrees"),
        ((Region.B, Region.D), "agrees in part"),
        ((Region.D,), "agrees in part"),
        ((), "does not agree"),
    ],
)
def test_a_multisine_must_lead_through_both_b_and_c(begun: tuple[Region, ...], verdict: str) -> None:
    def trial(*begun: Region) -> Trial:
        onsets = {region: Onset(0, 1.0, 100.0, False) for region in begun}
        region = max(begun, default=Region.A)
        return Trial(region, region, onsets, np.zeros(2), record(np.zeros((10, 2))))

    as_rms = replace(multisine.PAPERS, name="as rms")
    runs = {data.name: trial(*begun) for data in (*multisine.DATA, as_rms)}
    claim = multisine.region_claim(runs, as_rms)
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


@pytest.mark.parametrize(("hangs", "verdict"), [(60e-6, "agrees"), (1e-15, "does not agree")])
def test_an_offset_as_small_as_rounding_is_none(hangs: float, verdict: str) -> None:
    fits = np.array([99.0, 50.0]), np.array([99.0, 99.0])
    still = record(np.zeros((10, 2)))
    means = square_waves.Means(still, still, *fits, np.array([0.0, -hangs]), np.zeros(2))
    identified = SimpleNamespace(
        model=SimpleNamespace(unstable_poles=lambda: [1.02]), stable=True, closed_loop_poles=[0.9]
    )
    told = {claim.id: claim for claim in square_waves.claims(identified, means, np.array([99.0, 99.0]))}
    for name in ("square-waves-offset", "square-waves-means"):
        assert told[name].verdict == verdict
        assert bool(told[name].reason) == (verdict != "agrees")


def test_every_data_set_in_region_a_must_give_an_accurate_model() -> None:
    regions = regions_of_data(Region.B) | {multisine.PAPERS.name: Region.A}
    assert multisine.control_claim(trials(True, 50.0), regions).verdict == "agrees in part"


def test_a_model_is_stable_by_its_poles_and_its_simulation() -> None:
    assert ModelTrial("data", "pem", 4, 0.99, 50.0).stable
    assert not ModelTrial("data", "pem", 4, 1.01, 50.0).stable
    assert not ModelTrial("data", "pem", 4, 0.99, None).stable
    trial = ModelTrial("data", "pem", 4, None, None, "too few samples")
    assert not trial.stable
    assert ModelTask.from_json(ModelTask.to_json(trial)) == trial


def test_samples_through_ros_must_be_equal_bit_for_bit() -> None:
    without = LoopRun(record(np.ones((5, 2))), False)
    nearly = LoopRun(record(np.nextafter(np.ones((5, 2)), 2.0)), False)
    assert equality_claim("x", "Fig. 0", without, without).verdict == "agrees"
    assert equality_claim("x", "Fig. 0", without, nearly).verdict == "does not agree"
    assert equality_claim("x", "Fig. 0", without, replace(without, delevitated=True)).verdict == "does not agree"


def test_a_bag_counts_as_kept_while_files_and_code_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = GraphExperiment("squares", Square(amplitude=1e-6, duration=0.1))
    assert not experiment.is_kept(tmp_path)
    bag = tmp_path / "squares"
    bag.mkdir()
    (bag / "squares.mcap").write_bytes(b"samples")
    experiment.keep(tmp_path)
    assert experiment.is_kept(tmp_path)
    assert not GraphExperiment("squares", Square(amplitude=2e-6, duration=0.1)).is_kept(tmp_path)
    (bag / "squares.mcap").write_bytes(b"sample")
    assert not experiment.is_kept(tmp_path)
    experiment.keep(tmp_path)
    monkeypatch.setattr(graph_experiment, "code_version", lambda: "another")
    assert not experiment.is_kept(tmp_path)


def test_arx_recovers_a_plant_of_its_own_kind() -> None:
    random = np.random.default_rng(0)
    inputs, noise = random.normal(size=(4_000, 2)), 0.01 * random.normal(size=(4_000, 2))
    outputs = np.zeros((4_000, 2))
    a, b = np.array([[0.9, 0.1], [0.0, 0.7]]), np.array([[1.0, 0.0], [0.3, 0.5]])
    for step in range(1, 4_000):
        outputs[step] = a @ outputs[step - 1] + b @ inputs[step - 1] + noise[step]
    model = identify_arx(inputs, outputs, 1e-4, 1)
    np.testing.assert_allclose(model.c @ model.b, b, atol=2e-3)
    np.testing.assert_allclose(model.c @ model.a @ model.b, a @ b, atol=2e-3)
    assert model.order == 2
    longer = identify_arx([inputs[:2_000], inputs[2_000:]], [outputs[:2_000], outputs[2_000:]], 1e-4, 3)
    assert longer.order == 6
    np.testing.assert_allclose(np.sort(np.abs(longer.poles()))[-2:], [0.7, 0.9], atol=0.05)


@pytest.mark.parametrize(("lags", "message"), [(0, "0 lags are not allowed"), (25, "too few for 25 lags")])
def test_arx_says_which_lags_are_allowed(lags: int, message: str) -> None:
    random = np.random.default_rng(0)
    with pytest.raises(IdentificationError, match=message):
        identify_arx(random.normal(size=(100, 2)), random.normal(size=(100, 2)), 1e-4, lags)
