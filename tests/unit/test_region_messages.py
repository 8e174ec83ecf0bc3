"""Regions and region maps as messages and back."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from amb_core.ground.errors import RegionError
from amb_core.recording.messages.region_map import (
    fill_region_map,
    map_settings_from_message,
    region_map_from_message,
)
from amb_core.recording.messages.region_state import fill_region_state, region_state_from_message
from amb_core.regions import AxisState, BearingState, Onset, Region, RegionState
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap
from amb_msgs.action import BuildMap
from amb_msgs.msg import AxisRegion, BearingRegion
from amb_msgs.msg import RegionMap as RegionMapMessage
from amb_msgs.msg import RegionState as RegionStateMessage


def axis(name: str, region: Region, seed: float) -> AxisState:
    features = [seed * number for number in range(1, 9)]
    drift = Onset(4, 4e-4, 2_000.0, False) if region is Region.C else None
    return AxisState(
        region,
        Onset(5, 5e-4, math.nan, True),
        *features,
        sampling_beat=True,
        drift=drift,
        steady_frequency=15.9,
        steady_amplitude=2e-6,
        even_distortion=0.03,
        not_judged="BD",
        name=name,
    )


@pytest.fixture
def region_map() -> RegionMap:
    sweeps = (
        MapSweep(1e-5, {Region.C: Boundary(2_000.0, False)}, ((500.0, 510.5), (700.0, 720.0)), 5_000.0, 210_000),
        MapSweep(3e-5, {Region.B: Boundary(1 / 3, False), Region.D: Boundary(400.0, True)}, (), 400.0, 30_000),
    )
    return RegionMap(MapSettings(amplitude_low=1e-5), sweeps, {"plant": {"rotor": {"mass": 6.25}}}, False)


STATE = RegionState(
    12_345,
    (axis("x_a", Region.A, 1.5), axis("y_a", Region.C, -0.1), axis("z", Region.B, 0.3)),
    (BearingState("a", Region.C, 1e-4), BearingState("t", Region.B, 2e-4)),
    Region.C,
    Onset(5, 5e-4, 330.0, False),
    1e-4,
    True,
)


def message_of(state: RegionState) -> RegionStateMessage:
    return fill_region_state(RegionStateMessage(), AxisRegion, BearingRegion, state, run=3, sample_time=1e-4)


def test_a_state_comes_back_as_it_was() -> None:
    message = message_of(STATE)
    assert (message.run, message.header.stamp.sec, message.header.stamp.nanosec) == (3, 1, 234_500_000)
    assert repr(region_state_from_message(message)) == repr(STATE)


def test_a_state_of_version_0_1_has_the_axes_x_and_y_without_evidence_beside_their_region() -> None:
    new = {"name", "drifting", "drift", "oscillating", "oscillation", "even_distortion", "odd_distortion"}
    new |= {"steady_frequency", "steady_amplitude", "frozen", "not_judged"}
    message = message_of(STATE)
    x, y = (SimpleNamespace(**_attributes(part, without=new)) for part in message.axes[:2])
    old = SimpleNamespace(**_attributes(message, without={"axes", "bearings"}), x=x, y=y)
    state = region_state_from_message(old)
    assert [(part.name, part.region) for part in state.axes] == [("x", Region.A), ("y", Region.C)]
    assert (state.bearings, state.region, state.since, state.radius) == ((), Region.C, STATE.since, STATE.radius)
    for part, original in zip(state.axes, STATE.axes, strict=False):
        assert (part.bias, part.oscillation_frequency) == (original.bias, original.oscillation_frequency)
        assert (part.drift, part.oscillation, part.steady_amplitude) == (None, None, 0.0)
        assert math.isnan(part.even_distortion)


def _attributes(message: Any, without: set[str]) -> dict[str, object]:
    return {field: getattr(message, field) for field in message.get_fields_and_field_types() if field not in without}


def test_regions_have_the_numbers_of_the_library() -> None:
    assert {region.name: getattr(RegionStateMessage, region.name) for region in Region} == Region.__members__


def test_a_map_comes_back_as_it_was(region_map: RegionMap) -> None:
    assert region_map_from_message(fill_region_map(RegionMapMessage(), region_map)) == region_map


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("resonance_b", [True], "resonance_b has 1 elements; allowed: 2"),
        ("frequency_c", [math.nan] * 3, "frequency_c has 3 elements; allowed: 2"),
        ("steps", [], "steps has 0 elements; allowed: 2"),
        ("beat_end", [1.0], "beat_end has 1 elements; allowed: 2"),
        ("beat_sweep", [0, 2], "beat_sweep = 2 is not the index of a sweep; allowed: 0 to 1"),
        ("amplitude", [1e-5, math.nan], "amplitude = nan; allowed: finite numbers, 0 or more"),
        ("amplitude", [0.0, 1e-5], "amplitude = 0; allowed: finite numbers above 0"),
        ("amplitude", [3e-5, 1e-5], "in order of amplitude"),
        ("amplitude", [1e-5] * 1_001, "region map of 1001 sweeps: allowed: at most 1000 sweeps"),
        ("highest_frequency", [math.inf, 1.0], "highest_frequency = inf; allowed: finite numbers, 0 or more"),
        ("frequency_d", [math.nan, -1.0], "frequency_d = -1"),
        ("settings", "{}{", "field settings is not JSON"),
        ("settings", "[" * 100_000, "field settings is not JSON"),
        ("settings", "[]", "field settings is not a JSON object"),
        ("settings", '{"duration": NaN}', "parameter 'duration' = nan is not allowed; allowed: 0.1 to 600 s"),
        ("settings", '{"colour": 1}', "unknown parameter 'colour'"),
        ("provenance", "\n", "field provenance is not JSON"),
        ("provenance", "3", "field provenance is not a JSON object"),
    ],
)
def test_a_message_that_holds_no_map_is_refused_in_one_line(
    region_map: RegionMap, field: str, value: object, reason: str
) -> None:
    message = fill_region_map(RegionMapMessage(), region_map)
    setattr(message, field, value)
    with pytest.raises(RegionError) as caught:
        region_map_from_message(message)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_empty_goal_asks_for_the_defaults() -> None:
    assert map_settings_from_message(BuildMap.Goal()) == MapSettings()
    goal = BuildMap.Goal(amplitude_high=50e-6, rest=0.0, axes="both", max_sweeps=12)
    assert map_settings_from_message(goal) == MapSettings(amplitude_high=50e-6, rest=0.0, axes="both", max_sweeps=12)
    with pytest.raises(RegionError, match=r"'resolution' = 2\.0 is not allowed"):
        map_settings_from_message(BuildMap.Goal(resolution=2.0))


def test_the_goal_has_all_settings_of_a_map() -> None:
    others = {"parameter_file", "path"}
    assert set(BuildMap.Goal.get_fields_and_field_types()) == set(MapSettings.model_fields) | others
