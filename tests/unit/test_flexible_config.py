"""config/flexible.yaml: its file of modes, found from any working directory, and its loop."""

import os
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.ground.files.package_files import located
from amb_core.ground.parameters import load_parameters
from amb_core.linear.model.modes import modes_of
from amb_core.loop.control import ControllerParameters
from amb_core.plant import ModalData, Plant, PlantParameters, linearize, uniform_shaft
from amb_core.plant.data_files import file_checksums

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"


@pytest.fixture(autouse=True)
def installed(tmp_path, monkeypatch):
    """The package amb_bringup with the parameter files of the sources, before the one that is built."""
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "amb_bringup").touch()
    (tmp_path / "share" / "amb_bringup").mkdir()
    (tmp_path / "share" / "amb_bringup" / "config").symlink_to(CONFIG)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}{os.pathsep}{os.environ.get('AMENT_PREFIX_PATH', '')}")
    monkeypatch.chdir(tmp_path)


def parameters(running_speed: float = 0.0) -> PlantParameters:
    parameters = load_parameters(PlantParameters, CONFIG / "flexible.yaml", "simulator")
    return parameters.model_copy(update={"rotor": parameters.rotor.model_copy(update={"running_speed": running_speed})})


def test_its_modes_are_those_of_the_shaft_that_it_describes():
    kept, made = ModalData.load(CONFIG / "flexible_modes.npz"), uniform_shaft(0.9, 0.048, (-0.3, 0.3), bending_modes=2)
    for name in ("natural_frequencies", "damping_ratios", "bearings", "sensors", "unbalance", "weight", "gyroscopic"):
        np.testing.assert_allclose(getattr(kept, name), getattr(made, name), rtol=1e-9, atol=1e-12)
    assert kept.natural_frequencies[4] == pytest.approx(273.0, abs=0.5)


@pytest.mark.parametrize("rpm", [0.0, 6000.0])
def test_its_loop_is_stable_with_the_default_controller(rpm):
    model = linearize(Plant(parameters(rpm / 60.0)), ControllerParameters())
    assert model.stable
    assert model.peak_sensitivity < 2.0
    assert (np.abs(model.discrete.poles()) > 1.0).sum() == 4
    bending = modes_of(model.closed_loop).of_kind("bending")
    assert [mode.natural_hz for mode in bending] == pytest.approx([274.2, 274.2, 755.0, 755.0], abs=3.0)
    whirl = {0.0: ["planar"] * 4, 6000.0: ["backward", "forward"] * 2}
    assert [mode.whirl for mode in bending] == whirl[rpm]


def test_a_checksum_of_a_package_s_file_is_that_of_the_file(tmp_path):
    (checksum,) = file_checksums(parameters()).values()
    assert len(checksum) == 64


def test_a_path_without_a_package_is_left_as_it_is():
    assert located("a/b.npz") == Path("a/b.npz")
    assert located("package://amb_bringup/config/rig.yaml").samefile(CONFIG / "rig.yaml")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (
            "package://no_such/a.npz",
            "modal data package://no_such/a.npz: cannot be read: package 'no_such' is not found",
        ),
        ("package://", "package '' is not found"),
        ("package://amb_bringup/a.npz", "modal data package://amb_bringup/a.npz: cannot be read: No such file"),
    ],
)
def test_a_missing_package_or_file_is_one_line(path, message):
    with pytest.raises(PlantError, match=message):
        ModalData.load(path)
