"""The description of a machine: what a plant publishes is what is read, and what contradicts itself is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from amb_core.ground.errors import MachineError
from amb_core.loop.machine import MOST_AXES, Machine, radial_bearings
from amb_core.loop.records import LoopRecord
from amb_core.plant import PlantParameters, RotorParameters
from amb_core.plant.machine import machine_of
from amb_core.recording.messages.machine import fill_machine, machine_from_message

RIG = machine_of(PlantParameters(rotor=RotorParameters(model="rigid")))


def test_a_rotor_in_two_bearings_has_four_axes_with_their_places() -> None:
    assert RIG.axis_names == ("x_a", "y_a", "x_b", "y_b")
    assert [axis.bearing for axis in RIG.axes] == ["a", "a", "b", "b"]
    assert [axis.sensor_position for axis in RIG.axes] == [-0.15, -0.15, 0.15, 0.15]
    assert [bearing.clearance for bearing in RIG.bearings] == [250e-6, 250e-6]
    assert machine_of(PlantParameters()).axis_names == ("x", "y")


def test_a_machine_whose_positions_are_not_known_equals_another_description_of_it() -> None:
    first, second = (
        replace(RIG, axes=tuple(replace(axis, sensor_position=float("nan")) for axis in RIG.axes)) for _ in range(2)
    )
    assert first == second
    assert hash(first) == hash(second)
    assert first != RIG


@pytest.mark.parametrize(
    ("axes", "planes"),
    [
        (("x_a", "x_b", "y_a", "y_b"), [("x_a", "y_a"), ("x_b", "y_b")]),
        (("z", "x", "y"), [("x", "y")]),
        (("first", "second", "third"), []),
        (("first", "second"), [("first", "second")]),
    ],
)
def test_the_axes_of_a_radial_bearing_are_those_of_one_name(
    axes: tuple[str, ...], planes: list[tuple[str, str]]
) -> None:
    columns = np.tile(np.arange(float(len(axes))), (3, 1))
    found = radial_bearings(LoopRecord(0, 1e-4, columns, columns, columns, axes))
    assert [plane.axes for plane in found] == planes
    for plane in found:
        assert [axes[int(column)] for column in plane.position[0]] == list(plane.axes)


def test_a_message_holds_all_of_it() -> None:
    assert machine_from_message(fill_machine(SimpleNamespace(), SimpleNamespace, SimpleNamespace, RIG)) == RIG


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"axes": ()}, f"0 axes; allowed: 1 to {MOST_AXES}"),
        ({"axes": RIG.axes * 5}, f"20 axes; allowed: 1 to {MOST_AXES}"),
        ({"axes": RIG.axes[:1] * 2}, "axes 'x_a', 'x_a'; allowed: a name of its own for each axis"),
        ({"axes": (replace(RIG.axes[0], name=""),)}, "allowed: a name of its own"),
        ({"bearings": RIG.bearings[:1]}, "axis 'x_b' belongs to bearing 'b'; bearings: 'a'"),
        ({"sample_rate": math.nan}, "sample rate nan Hz; allowed: more than 0"),
        ({"sample_rate": 0.0}, "sample rate 0 Hz; allowed: more than 0"),
        ({"sample_rate": math.inf}, "sample rate inf Hz; allowed: more than 0"),
    ],
)
def test_a_machine_that_contradicts_itself_is_refused(change: dict[str, Any], reason: str) -> None:
    with pytest.raises(MachineError, match=reason):
        Machine(**{**vars(RIG), **change})


def test_a_name_that_is_too_long_is_refused_and_not_repeated_whole() -> None:
    machine = machine_of(PlantParameters())
    for changed in (
        {"name": "x" * 100_000},
        {"axes": (replace(machine.axes[0], name="x" * 100_000), machine.axes[1])},
        {"axes": (replace(machine.axes[0], bearing="x" * 100_000), machine.axes[1])},
    ):
        with pytest.raises(MachineError, match="of 100000 characters; allowed: 64") as problem:
            replace(machine, **changed)
        assert len(str(problem.value)) < 200
