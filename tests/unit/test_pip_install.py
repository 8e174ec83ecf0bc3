"""amb_core without ROS: a wheel and pip alone make an environment in which its examples run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = ROOT / "src" / "amb_core" / "README.md"
FOREIGN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "LD_LIBRARY_PATH")  # of the workspace


def environment() -> dict[str, str]:
    """The variables of this process without those of the workspace and of ROS."""
    return {
        name: value
        for name, value in os.environ.items()
        if name not in FOREIGN and not name.startswith(("AMENT_", "COLCON_", "CMAKE_", "ROS_", "RMW_", "_ROS"))
    }


def run(folder: Path, *command: str | Path, **variables: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env=environment() | variables,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{done.stdout[-2_000:]}\n{done.stderr[-4_000:]}"
    return done


def built(folder: Path) -> Path:
    """A wheel of amb_core, built in an empty folder from an sdist, which is made where the sources lie as here."""
    sources, empty = folder / "src" / "amb_core", folder / "empty"
    left_out = shutil.ignore_patterns("__pycache__", "build", "*.egg*")
    shutil.copytree(ROOT / "src" / "amb_core", sources, symlinks=True, ignore=left_out)
    shutil.copytree(ROOT / "target", folder / "target")
    empty.mkdir()
    code = f"from setuptools.build_meta import build_sdist; build_sdist({str(empty)!r})"
    run(sources, sys.executable, "-c", code)
    (sdist,) = empty.iterdir()
    run(empty, sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", sdist.name)
    (wheel,) = empty.glob("amb_core-*.whl")
    return wheel


EMULATION = """
import amb_core
from amb_core.rig.emulation import Address, FaultParameters, LimitParameters, TargetEmulator, reference_library
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import PlantParameters

print(amb_core.__file__, reference_library())
machine = PlantParameters(), ControllerParameters()
emulator = TargetEmulator(*machine, LimitParameters(), FaultParameters(), reference_library(), Address(port=0))
emulator.close()
"""


def test_a_wheel_from_an_sdist_emulates_a_target(tmp_path: Path) -> None:
    """The C code of the target lies outside the folder of the package, from which an sdist takes its files."""
    installed, cache = tmp_path / "installed", tmp_path / "cache"
    run(tmp_path, sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", installed, built(tmp_path))
    alone = {"PYTHONPATH": str(installed), "XDG_CACHE_HOME": str(cache)}
    places = run(tmp_path / "empty", sys.executable, "-c", EMULATION, **alone).stdout.split()
    assert places == [str(installed / "amb_core" / "__init__.py"), str(cache / "amb" / "target" / "libamb_target.so")]


def test_a_package_without_the_code_of_the_target_is_not_built(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "src" / "amb_core", tmp_path / "amb_core", symlinks=True)
    refused = subprocess.run(
        [sys.executable, "setup.py", "--version"], cwd=tmp_path / "amb_core", capture_output=True, text=True
    )
    assert refused.returncode != 0
    assert "has no C code" in refused.stderr


@pytest.mark.slow
@pytest.mark.timeout(3_600)  # downloads some 200 MB, and compiles all kernels
def test_the_examples_run_where_pip_alone_has_installed_the_library(tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    pins = tmp_path / "tested.txt"
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    pins.write_text("\n".join(line for line in lines if "==" in line and "[" not in line) + "\n")
    run(tmp_path, python, "-m", "pip", "install", "-q", "--no-input", "-c", pins, f"{built(tmp_path)}[all]")
    run(tmp_path, python, "-m", "pip", "check")
    # nothing of ROS, and nothing of this checkout
    shown = run(
        tmp_path, python, "-c", "import amb_core, importlib.util as u; print(amb_core.__file__, u.find_spec('rclpy'))"
    )
    assert shown.stdout.split()[0].startswith(str(tmp_path / "venv"))
    assert shown.stdout.split()[1] == "None"
    examples = re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.DOTALL | re.MULTILINE)
    assert len(examples) >= 5
    script = tmp_path / "examples.py"
    script.write_text("\n".join(examples))
    run(tmp_path, python, script)
    assert (tmp_path / "model.json").stat().st_size > 1_000
    assert (tmp_path / "response.png").stat().st_size > 10_000
