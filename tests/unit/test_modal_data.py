"""The file of modal data: what is written is read, and what cannot be the modes of a rotor is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.plant.modal_data import ModalData

MODES = 6


def arrays(**changes: Any) -> dict[str, Any]:
    """Arrays of a rotor: rigid body modes that move the two journals, and a bending mode in each plane."""
    shapes = np.kron([[0.3, -0.3, 0.5], [0.3, 0.3, 0.5]], np.eye(2))
    gyroscopic = np.kron(np.diag([0.0, 0.03, 0.01]), [[0.0, 1.0], [-1.0, 0.0]])
    return {
        "natural_frequencies": np.array([0.0, 0.0, 0.0, 0.0, 300.0, 300.0]),
        "damping_ratios": np.full(MODES, 0.01),
        "bearings": shapes,
        "sensors": shapes,
        "unbalance": np.kron([[0.3, 0.0, -0.2]], np.eye(2)),
        "weight": np.array([0.0, -3.5, 0.0, 0.0, 0.0, 0.0]),
        "gyroscopic": gyroscopic,
    } | changes


def test_file_keeps_every_bit(tmp_path):
    data = ModalData(**arrays(), description="test rig")
    data.save(tmp_path / "rotor.npz")
    loaded = ModalData.load(tmp_path / "rotor.npz")
    assert loaded.description == "test rig"
    for name, array in arrays().items():
        assert np.array_equal(getattr(loaded, name), array), name


def test_file_of_another_program_needs_no_description(tmp_path):
    np.savez(tmp_path / "rotor.npz", **{name: np.float32(array) for name, array in arrays().items()})
    data = ModalData.load(tmp_path / "rotor.npz")
    assert data.modes == MODES
    assert data.description == ""
    assert data.bearings.dtype == np.float64


def test_arrays_cannot_be_changed():
    bearings = arrays()["bearings"]
    data = ModalData(**arrays(bearings=bearings))
    with pytest.raises(ValueError, match="read-only"):
        data.bearings[0, 0] = 1.0
    bearings[0, 0] = 7.0
    assert data.bearings[0, 0] == 0.3


@pytest.mark.parametrize("name", ["bearings", "sensors", "unbalance"])
def test_mode_shapes_of_the_wrong_size_are_refused(tmp_path, name):
    content = arrays()
    content[name] = content[name][:, :-1]
    shape, needed = content[name].shape, arrays()[name].shape
    np.savez(tmp_path / "rotor.npz", **content)
    with pytest.raises(PlantError) as error:
        ModalData.load(tmp_path / "rotor.npz")
    assert str(error.value) == (
        f"modal data {tmp_path / 'rotor.npz'}: '{name}' has shape {shape}; {needed} is needed, for 6 modes"
    )


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"natural_frequencies": np.zeros((6, 1))}, r"'natural_frequencies' has shape \(6, 1\); \(n,\) is needed"),
        ({"natural_frequencies": np.zeros(0)}, r"'natural_frequencies' has shape \(0,\); \(n,\) is needed"),
        (
            {"natural_frequencies": np.array([0, 0, 0, 0, 300, -301.5])},
            "has -301.5 Hz for mode 6; allowed: 0 and above",
        ),
        ({"damping_ratios": np.full(5, 0.01)}, r"'damping_ratios' has shape \(5,\); \(6,\) is needed, for 6 modes"),
        ({"damping_ratios": np.array([0, 0, 0, 0, 0.01, -0.01])}, "has -0.01 for mode 6; allowed: 0 to 1"),
        ({"damping_ratios": np.array([0, 0, 0, 0, 1.5, 0.01])}, "has 1.5 for mode 5; allowed: 0 to 1"),
        ({"weight": np.array([0, -3.5, 0, 0, np.nan, 0])}, "'weight' holds values that are not finite"),
        ({"bearings": arrays()["bearings"] * 1j}, "'bearings' holds complex128 values; real numbers are needed"),
        ({"sensors": np.full((4, 6), "1")}, "'sensors' holds <U1 values; real numbers are needed"),
        ({"gyroscopic": np.abs(arrays()["gyroscopic"])}, "'gyroscopic' is not skew: .* reaches 0.06; .* is 0.03"),
        (
            {"bearings": np.kron(np.ones((2, 3)), np.eye(2))},
            "'bearings' has rank 2, needed: 4; are the four rigid body",
        ),
    ],
)
def test_what_cannot_be_a_rotor_is_refused(changes, reason):
    with pytest.raises(PlantError, match=reason):
        ModalData(**arrays(**changes))


# -- files


def load_error(path: Path) -> str:
    with pytest.raises(PlantError) as error:
        ModalData.load(path)
    assert str(error.value).startswith(f"modal data {path}: ")
    assert "\n" not in str(error.value)
    return str(error.value)


def test_missing_file_is_named(tmp_path):
    assert load_error(tmp_path / "none.npz").endswith("cannot be read: No such file or directory")
    assert "cannot be read: is a folder" in load_error(tmp_path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"H,B\n0,0\n"])
def test_file_of_another_kind_is_refused(tmp_path, content):
    (tmp_path / "rotor.npz").write_bytes(content)
    assert "is not an .npz file" in load_error(tmp_path / "rotor.npz")


def test_single_array_is_refused(tmp_path):
    np.save(tmp_path / "rotor.npy", np.zeros(3))
    assert "is a single array (.npy); needed: an .npz with natural_frequencies" in load_error(tmp_path / "rotor.npy")


def test_pickled_objects_are_not_loaded(tmp_path):
    np.savez(tmp_path / "rotor.npz", **arrays(weight=np.array([None] * MODES)))
    assert "is not an .npz file: Object arrays cannot be loaded" in load_error(tmp_path / "rotor.npz")


def test_missing_and_unknown_arrays_are_named(tmp_path):
    content = arrays()
    content["weights"] = content.pop("weight")
    np.savez(tmp_path / "rotor.npz", **content)
    assert "lacks weight; found natural_frequencies, damping_ratios" in load_error(tmp_path / "rotor.npz")
    np.savez(tmp_path / "rotor.npz", **arrays(speed=1.0))
    assert "unknown speed; known: natural_frequencies, " in load_error(tmp_path / "rotor.npz")


def test_file_is_written_as_npz_or_not_at_all(tmp_path):
    data = ModalData(**arrays())
    with pytest.raises(PlantError, match=r"rotor\.mat: the file name must end in \.npz"):
        data.save(tmp_path / "rotor.mat")
    with pytest.raises(PlantError, match="cannot be written: No such file or directory"):
        data.save(tmp_path / "none" / "rotor.npz")
