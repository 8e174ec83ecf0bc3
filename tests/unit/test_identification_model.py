"""The state-space model: poles, conversion, and storage that does not lose a bit."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.io import savemat

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel

if TYPE_CHECKING:
    from conftest import LinearBearing


def random_model() -> StateSpaceModel:
    """A model of order 3 with awkward numbers."""
    random = np.random.default_rng(5)
    awkward = np.array([[np.pi, 1e-310], [-0.0, 1.0 / 3.0]])
    return StateSpaceModel(
        a=random.normal(size=(3, 3)),
        b=random.normal(size=(3, 2)) * 1e-9,
        c=random.normal(size=(2, 3)),
        d=np.zeros((2, 2)),
        k=random.normal(size=(3, 2)) * 1e7,
        innovation_covariance=awkward,
        input_offset=random.normal(size=2),
        output_offset=random.normal(size=2),
        initial_state=random.normal(size=3),
        sample_time=1e-4,
        method="n4sid",
        source="results/démo.mcap",
        samples=40_000,
        fit=np.array([99.1, -np.inf]),
    )


def assert_identical(one: StateSpaceModel, other: StateSpaceModel) -> None:
    for item in fields(StateSpaceModel):
        mine, theirs = getattr(one, item.name), getattr(other, item.name)
        if isinstance(mine, np.ndarray):
            assert mine.shape == theirs.shape
            assert mine.tobytes() == theirs.tobytes(), item.name
        else:
            assert mine == theirs, item.name


@pytest.mark.parametrize("ending", ["json", "npz"])
@pytest.mark.parametrize("fit", [[99.1, -np.inf], []])
def test_saving_and_loading_keeps_every_bit(tmp_path: Path, ending: str, fit: list[float]) -> None:
    model = replace(random_model(), fit=np.array(fit))
    model.save(tmp_path / f"model.{ending}")
    assert_identical(model, StateSpaceModel.load(tmp_path / f"model.{ending}"))


def test_a_model_is_read_from_its_folder_of_results(tmp_path: Path) -> None:
    model = random_model()
    model.save(tmp_path / "model.json")
    assert_identical(model, StateSpaceModel.load(tmp_path))
    (tmp_path / "model.json").unlink()
    with pytest.raises(IdentificationError, match=r"model .*model\.json: cannot be read: No such file"):
        StateSpaceModel.load(tmp_path)


def test_the_json_file_is_strict_json_with_the_names_of_the_message(tmp_path: Path) -> None:
    random_model().save(tmp_path / "model.json")

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    content = json.loads((tmp_path / "model.json").read_text(), parse_constant=refuse)
    assert content["sample_time"] == 1e-4
    assert content["input_names"] == ["i_x", "i_y"]
    assert content["fit"] == [99.1, "-inf"]


def test_poles_of_the_bearing_are_the_closed_form_ones(bearing: LinearBearing) -> None:
    model = bearing.model
    stiffness = np.array([bearing.stiffness_x, bearing.stiffness_y])
    uncoupled = np.exp(np.sqrt(stiffness / bearing.mass) * bearing.sample_time)
    # The coupling of positions is triangular, so it does not move the poles.
    assert model.unstable_poles() == pytest.approx(uncoupled, rel=1e-9)
    assert len(model.poles()) == 6
    assert np.all(np.diff(np.abs(model.poles())) <= 0.0)


def test_python_control_gets_the_same_system(bearing: LinearBearing) -> None:
    model = bearing.model
    system = model.to_control()
    assert system.dt == model.sample_time
    assert np.array_equal(system.A, model.a)
    assert np.array_equal(system.B, model.b)
    assert np.array_equal(system.C, model.c)
    assert system.input_labels == ["i_x", "i_y"]
    assert system.output_labels == ["x", "y"]


def test_arrays_are_copies_that_cannot_be_changed() -> None:
    a = np.eye(3)
    model = replace(random_model(), a=a)
    a[0, 0] = 5.0
    assert model.a[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        model.a[0, 0] = 5.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"b": np.zeros((2, 2))}, r"'b' has shape \(2, 2\); \(3, 2\) is needed"),
        ({"k": np.full((3, 2), np.nan)}, "'k' holds values that are not finite"),
        ({"fit": np.array([np.nan, 1.0])}, "'fit'"),
        ({"fit": np.array([1.0])}, "'fit'"),
        ({"sample_time": 0.0}, "'sample_time' = 0.0 s"),
        ({"a": np.eye(3) + 1e-3j}, "a: ndarray.* is not allowed; allowed: an array of real numbers"),
    ],
)
def test_a_model_whose_parts_do_not_fit_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        replace(random_model(), **change)


def test_files_that_hold_no_model_are_refused_in_one_line(tmp_path: Path) -> None:
    random_model().save(tmp_path / "model.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "model.npz").read_bytes()[:500])
    (tmp_path / "cut.json").write_text('{"a": [')
    (tmp_path / "other.json").write_text('{"a": []}')
    (tmp_path / "list.json").write_text("[]")
    for name, message in [
        ("missing.json", "cannot be read"),
        ("cut.json", "is damaged"),
        ("cut.npz", "is damaged"),
        ("other.json", "expected the fields"),
        ("list.json", "expected the fields"),
        ("model.txt", "must end in .json, .npz or .mat"),
    ]:
        with pytest.raises(IdentificationError, match=message) as refusal:
            StateSpaceModel.load(tmp_path / name)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_complex_matrices_of_a_file_are_refused_and_those_without_imaginary_part_read(
    tmp_path: Path, ending: str
) -> None:
    model, path = random_model(), tmp_path / f"model.{ending}"
    kind = str if ending == "npz" else object
    names = {"InputName": np.array(["i_x", "i_y"], kind), "OutputName": np.array(["x", "y"], kind)}
    rest = {"B": model.b, "C": model.c, "D": model.d, "Ts": 1e-4, **names}

    def saved(a: np.ndarray) -> Path:
        if ending == "npz":
            np.savez(path, A=a, **rest)
        else:
            savemat(path, {"A": a, **rest})
        return path

    np.testing.assert_array_equal(StateSpaceModel.load(saved(model.a + 0j)).a, model.a)
    with pytest.raises(IdentificationError, match=r"a: .* is not allowed; allowed: an array of real numbers"):
        StateSpaceModel.load(saved(model.a + 1e-3j))


def test_a_model_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match="cannot be written"):
        random_model().save(tmp_path / "no_such_folder" / "model.json")
