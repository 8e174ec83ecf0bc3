"""Regions of a machine of several bearings: by axis, by bearing and of the rotor."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.ground.errors import RegionError
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord, axis_names
from amb_core.regions import (
    Region,
    RegionClassifier,
    RegionParameters,
    RegionState,
    classify,
    layout_of,
    layout_without_machine,
)

RATE = 10_000.0
STEPS = 25_000
TIME = np.arange(STEPS) / RATE


def machine(axes: int, **clearance: float) -> Machine:
    """Bearings a and b, with a thrust bearing t of the last of five axes."""
    names = axis_names(axes)
    bearings = [name[2:] if "_" in name else "t" for name in names]
    return Machine(
        "rig",
        "bridge",
        RATE,
        tuple(
            MachineAxis(name, bearing, 0.0, 0.0, (1.0, 0.0, 0.0), 3.0, 3.0)
            for name, bearing in zip(names, bearings, strict=True)
        ),
        tuple(MachineBearing(name, clearance.get(name, 200e-6)) for name in dict.fromkeys(bearings)),
    )


def telemetry(axes: int = 4, **signals: NDArray[np.float64]) -> LoopRecord:
    """Noise on all axes; signals by the name of their axis, those of a reference by `r_` and its name (m)."""
    names = axis_names(axes)
    position = np.random.default_rng(5).normal(scale=0.05e-6, size=(STEPS, axes))
    reference = np.zeros((STEPS, axes))
    for name, signal in signals.items():
        (reference if name.startswith("r_") else position)[:, names.index(name.removeprefix("r_"))] += signal
    return LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))


def tone(frequency: float, amplitude: float) -> NDArray[np.float64]:
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME)


def first_bearing(record: LoopRecord) -> LoopRecord:
    return LoopRecord(0, record.sample_time, record.reference[:, :2], record.position[:, :2], record.current[:, :2])


@pytest.fixture(scope="module")
def drifting() -> LoopRecord:
    """A drift on y_b only, from 1 s on."""
    return telemetry(y_b=-30e-6 * np.clip(TIME - 1.0, 0.0, None))


def touch(axis: str, displacement: float, steps: int = 100) -> LoopRecord:
    """One axis displaced (m) for some steps, 1.5 s after the start."""
    return telemetry(5, **{axis: np.where((TIME >= 1.5) & (1.5 + steps / RATE > TIME), displacement, 0.0)})


def test_a_drift_of_one_axis_is_that_of_its_bearing_and_of_the_rotor(drifting: LoopRecord) -> None:
    classification = classify(drifting, machine=machine(4))
    state = classification.states[-1]
    assert {axis.name: axis.region.name for axis in state.axes} == {"x_a": "A", "y_a": "A", "x_b": "A", "y_b": "B"}
    assert [(bearing.name, bearing.region.name) for bearing in state.bearings] == [("a", "A"), ("b", "B")]
    assert (state.region, state.since) == (Region.B, state.axis("y_b").since)
    assert state.since.time == pytest.approx(1.0, abs=0.15)
    assert classification.onsets == classification.axis_onsets["y_b"] == {Region.B: state.since}


def test_the_rotor_is_in_its_highest_region_from_the_earliest_onset_of_it() -> None:
    drift = -30e-6 * np.clip(TIME - 1.5, 0.0, None)
    slow = np.where(TIME > 1.0, tone(60.0, 10e-6), 0.0)
    slow_later = np.where(TIME > 1.8, tone(60.0, 10e-6), 0.0)
    state = classify(telemetry(x_a=slow_later, y_a=drift, x_b=slow)).states[-1]
    assert [axis.region.name for axis in state.axes] == ["C", "B", "C", "A"]
    assert (state.region, state.since) == (Region.C, state.axis("x_b").since)


@pytest.mark.parametrize("sizes", [(100,), (1, 1, 1, 397), (4_096,)])
def test_states_do_not_depend_on_the_block_size(sizes: tuple[int, ...]) -> None:
    record = touch("y_b", 205e-6)
    layout = layout_of(machine(5))
    classifier = RegionClassifier(RegionParameters(), record.sample_time, layout)
    states: list[RegionState] = []
    start = 0
    for size in cycle(sizes):
        size = min(size, record.steps - start)
        if size == 0:
            break
        states += classifier.feed(record.window(start, size))
        start += size
    assert repr(states) == repr(classify(record, machine=machine(5)).states)


@pytest.mark.parametrize("excited", [False, True])
def test_a_bearing_has_the_states_that_it_has_alone(drifting: LoopRecord, excited: bool) -> None:
    sine = tone(1_000.0, 20e-6) * (TIME > 0.4)
    record = telemetry(r_y_a=sine, x_a=0.01 * sine, y_a=0.1 * sine, x_b=1e-3 * sine) if excited else drifting
    alone = classify(first_bearing(record), clearance={"x": 250e-6, "y": 250e-6}).states
    together = classify(record, machine=machine(4, a=250e-6, b=250e-6)).states
    assert [state.step for state in together] == [state.step for state in alone]
    for state, expected in zip(together, alone, strict=True):
        axes = tuple(replace(axis, name=axis.name[0]) for axis in state.axes[:2])
        assert repr(axes) == repr(expected.axes)  # repr: NaN is like NaN
        assert state.bearings[0].radius == expected.bearings[0].radius


def test_touching_one_bearing_is_region_d_of_it_and_of_the_rotor() -> None:
    classification = classify(touch("y_b", 205e-6), machine=machine(5))
    first = next(state for state in classification.states if state.region is Region.D)
    assert first.step == first.since.step == 15_000
    assert {bearing.name: bearing.region.name for bearing in first.bearings} == {"a": "A", "b": "D", "t": "A"}
    assert {axis.name for axis in first.axes if axis.region is Region.D} == {"x_b", "y_b"}
    assert first.radius == first.bearings[1].radius == pytest.approx(205e-6, abs=1e-6)
    assert first.bearings[0].radius < 1e-6
    left = next(state for state in classification.states if state.step > first.step and state.region is not Region.D)
    assert left.step == pytest.approx(15_100 + 0.2 * RATE, abs=201)


def test_a_thrust_bearing_is_touched_in_either_direction_and_has_no_radius() -> None:
    for displacement in (-205e-6, 205e-6):
        classification = classify(touch("z", displacement), machine=machine(5))
        first = next(state for state in classification.states if state.region is Region.D)
        assert (first.step, first.bearings[2].region) == (15_000, Region.D)
        assert first.bearings[2].radius == pytest.approx(205e-6, abs=1e-6)
        assert first.radius < 1e-6


def test_a_thrust_axis_drifts_and_oscillates_as_any_other() -> None:
    drift = classify(telemetry(5, z=-30e-6 * np.clip(TIME - 1.0, 0.0, None)), machine=machine(5)).states[-1]
    assert (drift.axis("z").region, drift.region) == (Region.B, Region.B)
    slow = classify(telemetry(5, z=np.where(TIME > 1.0, tone(60.0, 10e-6), 0.0)), machine=machine(5)).states[-1]
    assert (slow.axis("z").region, slow.bearings[2].region) == (Region.C, Region.C)


def test_a_machine_of_one_axis_has_regions() -> None:
    one = machine(1)
    record = telemetry(1, x=np.where(TIME > 1.5, 205e-6, 0.0))
    assert classify(record, machine=one).onsets[Region.D].step == 15_001
    assert list(classify(record).axis_onsets["x"]) == [Region.B], "without a machine its clearance is not known"


def test_clearances_are_those_of_the_machine_unless_a_radius_is_given() -> None:
    record = touch("y_b", 205e-6)
    assert Region.D in classify(record, machine=machine(5)).onsets
    assert Region.D not in classify(record, machine=machine(5, b=210e-6)).onsets
    assert Region.D not in classify(record).onsets, "without a machine the default, 250 um"
    assert Region.D in classify(record, RegionParameters(backup_bearing_radius=204e-6)).onsets
    axial = touch("z", 205e-6)
    assert Region.D not in classify(axial, RegionParameters(backup_bearing_radius=204e-6)).onsets, "not a radial one"


@pytest.mark.parametrize("unknown", [math.nan, 0.0, math.inf])
def test_an_unknown_clearance_is_never_reached(unknown: float) -> None:
    assert Region.D not in classify(touch("y_b", 1e-3), machine=machine(5, b=unknown)).onsets


def test_a_delevitation_without_a_sample_is_that_of_the_closest_bearing() -> None:
    record = telemetry(x_b=190e-6 * (TIME > 2.4), x_a=195e-6 * (TIME > 2.4))
    state = classify(record, machine=machine(4, a=300e-6), delevitated=True).states[-1]
    assert (state.since.step, [bearing.region.name for bearing in state.bearings]) == (STEPS, ["B", "D"])


def test_motion_that_follows_an_input_at_another_bearing_is_no_region_of_its_own() -> None:
    """The rotor moves in bearing b with a slow sine of the reference of x_a."""
    sine = tone(20.0, 20e-6) * (TIME > 0.4)
    classification = classify(telemetry(r_x_a=sine, x_a=sine, x_b=0.3 * sine, y_b=0.1 * sine), machine=machine(4))
    assert classification.onsets == {}
    assert classification.states[-1].axis("y_b").input_frequency == pytest.approx(20.0, rel=0.01)


def test_an_axis_takes_the_input_of_its_bearing_before_that_of_its_plane() -> None:
    layout = layout_of(machine(5))
    named = {
        layout.axes[axis]: [layout.axes[other] for other in others] for axis, others in enumerate(layout.neighbours())
    }
    assert named["x_b"] == ["y_b", "x_a", "y_a", "z"]
    assert named["y_a"] == ["x_a", "y_b", "x_b", "z"]
    assert layout_without_machine(("x",)).neighbours() == [[]]


def test_without_a_machine_axes_of_one_ending_are_a_bearing() -> None:
    def bearings(*axes: str) -> list[tuple[str, tuple[str, ...]]]:
        return [(bearing.name, bearing.axes) for bearing in layout_without_machine(axes).bearings]

    assert bearings("x", "y") == [("a", ("x", "y"))]
    assert bearings("pos1", "pos2") == [("a", ("pos1", "pos2"))]
    assert bearings("x_a", "y_a", "x_b", "y_b", "z") == [("a", ("x_a", "y_a")), ("b", ("x_b", "y_b")), ("z", ("z",))]
    assert bearings("x_a", "x_b", "y_a", "y_b") == [("a", ("x_a", "y_a")), ("b", ("x_b", "y_b"))]


def test_telemetry_of_other_axes_is_refused(drifting: LoopRecord) -> None:
    with pytest.raises(RegionError, match=r"the axes are x_a, y_a, x_b, y_b at step 0; .* made for x, y"):
        RegionClassifier(RegionParameters(), 1.0 / RATE).feed(drifting)
    position = drifting.position.copy()
    position[7, 2] = math.nan
    with pytest.raises(RegionError, match="position x_b is nan at step 7"):
        classify(replace(drifting, position=position))


def test_a_state_names_its_axes(drifting: LoopRecord) -> None:
    with pytest.raises(RegionError, match="no axis 'x' at step 99; its axes: x_a, y_a, x_b, y_b"):
        classify(drifting.window(0, 100)).states[-1].axis("x")
