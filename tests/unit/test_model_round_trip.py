"""Models of every size come back from messages and files as they were, bit for bit."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel
from amb_core.linear import LinearSystem
from amb_core.loop.known_controller import LinearControl
from amb_core.recording.messages.state_space_model import fill_model, model_from_message
from amb_msgs.msg import StateSpaceModel as StateSpaceModelMessage

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)  # the smallest, the largest and -0.0 among them
# What ends a string in C cannot be in a message, what is half a character cannot be in a file.
TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)


@st.composite
def models(draw: st.DrawFn) -> StateSpaceModel:
    n, m, p = draw(st.integers(1, 5)), draw(st.integers(1, 3)), draw(st.integers(1, 3))
    values = draw(st.lists(NUMBERS, min_size=1, max_size=4))
    random = np.random.default_rng(draw(st.integers(0, 1000)))

    def numbers(*shape: int) -> Any:
        return np.where(random.random(shape) < 0.5, random.choice(values, shape), random.normal(size=shape))

    def texts(count: int) -> tuple[str, ...]:
        return tuple(draw(st.lists(TEXTS, min_size=count, max_size=count)))

    fit = st.sampled_from([99.5, 100.0, -1e300, -np.inf])
    return StateSpaceModel(
        a=numbers(n, n),
        b=numbers(n, m),
        c=numbers(p, n),
        d=numbers(p, m),
        k=numbers(n, p),
        innovation_covariance=numbers(p, p),
        input_offset=numbers(m),
        output_offset=numbers(p),
        initial_state=numbers(n),
        sample_time=draw(st.floats(min_value=0.0, exclude_min=True, allow_infinity=False)),
        input_names=texts(m),
        output_names=texts(p),
        input_units=texts(m),
        output_units=texts(p),
        method=draw(TEXTS),
        source=draw(TEXTS),
        samples=draw(st.integers(0, 2**50)),
        fit=np.array(draw(st.lists(fit, min_size=p, max_size=p)) if draw(st.booleans()) else []),
    )


def assert_identical(one: StateSpaceModel, other: StateSpaceModel) -> None:
    for item in fields(StateSpaceModel):
        mine, theirs = getattr(one, item.name), getattr(other, item.name)
        if isinstance(mine, np.ndarray):
            assert mine.shape == theirs.shape, item.name
            assert mine.tobytes() == theirs.tobytes(), item.name
        else:
            assert (type(mine), mine) == (type(theirs), theirs), item.name


@settings(deadline=None)
@given(models())
def test_messages_keep_every_bit(model: StateSpaceModel) -> None:
    message = fill_model(StateSpaceModelMessage(), model)
    received = deserialize_message(serialize_message(message), StateSpaceModelMessage)
    assert received == message
    assert_identical(model, model_from_message(received))


@pytest.mark.parametrize("ending", ["json", "npz", "mat"])
@settings(max_examples=30, deadline=None)
@given(model=models())
def test_files_keep_every_bit(tmp_path_factory: pytest.TempPathFactory, ending: str, model: StateSpaceModel) -> None:
    file = tmp_path_factory.getbasetemp() / f"model.{ending}"
    model.save(file)
    assert_identical(model, StateSpaceModel.load(file))


@pytest.fixture
def unitless(tmp_path: Path) -> StateSpaceModel:
    return StateSpaceModel(
        *(np.eye(2) for _ in range(6)), np.zeros(2), np.zeros(2), np.zeros(2), sample_time=1e-4, method="old"
    )


@pytest.mark.parametrize("of", [int, np.int64, np.float32])
def test_messages_carry_a_sample_time_and_a_number_of_samples_of_every_type(unitless: StateSpaceModel, of: Any) -> None:
    model = replace(unitless, sample_time=of(1), samples=np.int64(5))
    sent = serialize_message(fill_model(StateSpaceModelMessage(), model))
    message = deserialize_message(sent, StateSpaceModelMessage)
    assert (message.sample_time, message.samples) == (1.0, 5)


@pytest.mark.parametrize("ending", ["json", "npz", "mat"])
def test_files_keep_a_static_gain(tmp_path: Path, ending: str) -> None:
    gain = 2e4 * np.eye(2)
    law = LinearSystem(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), gain.tolist(), 1e-4)
    static = LinearControl.of(law).model
    static.save(tmp_path / f"static.{ending}")
    assert_identical(StateSpaceModel.load(tmp_path / f"static.{ending}"), static)
    assert np.array_equal(LinearControl.load(tmp_path / f"static.{ending}").model.d, gain)


def test_units_are_those_of_the_bearing_where_none_are_given(unitless: StateSpaceModel) -> None:
    assert (unitless.input_units, unitless.output_units) == (("A", "A"), ("m", "m"))
    volts = replace(unitless, input_units=("V", "V"), output_units=("", "rad"))
    assert (volts.input_units, volts.output_units) == (("V", "V"), ("", "rad"))
    with pytest.raises(IdentificationError, match="2 texts or none are needed"):
        replace(unitless, output_units=("m",))


def test_files_without_units_still_load(unitless: StateSpaceModel, tmp_path: Path) -> None:
    for ending in ("json", "npz"):
        unitless.save(tmp_path / f"new.{ending}")
    content = json.loads((tmp_path / "new.json").read_text())
    (tmp_path / "old.json").write_text(
        json.dumps({name: value for name, value in content.items() if not name.endswith("_units")})
    )
    with np.load(tmp_path / "new.npz") as archive:
        np.savez(tmp_path / "old.npz", **{name: archive[name] for name in archive.files if not name.endswith("_units")})
    for ending in ("json", "npz"):
        assert_identical(unitless, StateSpaceModel.load(tmp_path / f"old.{ending}"))


def test_messages_without_units_still_tell_a_model(unitless: StateSpaceModel) -> None:
    message = fill_model(StateSpaceModelMessage(), unitless)
    old = type("OldMessage", (), {})()
    for name in message.get_fields_and_field_types():
        if not name.endswith("_units"):
            setattr(old, name, getattr(message, name))
    assert_identical(unitless, model_from_message(old))
