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


def run(folder: Path, *command: str | Path) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        list(map(str, command)), cwd=folder, env=environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{done.stdout[-2_000:]}\n{done.stderr[-4_000:]}"
    return done


@pytest.mark.slow
@pytest.mark.timeout(3_600)  # downloads some 200 MB, and compiles all kernels
def test_the_examples_run_where_pip_alone_has_installed_the_library(tmp_path: Path) -> None:
    sources = tmp_path / "src" / "amb_core"  # pip builds in the folder of the sources
    shutil.copytree(ROOT / "src" / "amb_core", sources, ignore=shutil.ignore_patterns("__pycache__", "build", "*.egg*"))
    shutil.copytree(ROOT / "target", tmp_path / "target")
    run(tmp_path, sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-w", tmp_path, sources)
    (wheel,) = tmp_path.glob("amb_core-*.whl")
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    pins = tmp_path / "tested.txt"
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    pins.write_text("\n".join(line for line in lines if "==" in line and "[" not in line) + "\n")
    run(tmp_path, python, "-m", "pip", "install", "-q", "--no-input", "-c", pins, wheel)
    run(tmp_path, python, "-m", "pip", "check")
    # nothing of ROS, and nothing of this checkout
    found = run(
        tmp_path, python, "-c", "import amb_core, importlib.util as u; print(amb_core.__file__, u.find_spec('rclpy'))"
    )
    assert found.stdout.split()[0].startswith(str(tmp_path / "venv"))
    assert found.stdout.split()[1] == "None"
    examples = re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.DOTALL | re.MULTILINE)
    assert len(examples) >= 5
    script = tmp_path / "examples.py"
    script.write_text("\n".join(examples))
    run(tmp_path, python, script)
    assert (tmp_path / "model.json").stat().st_size > 1_000
    assert (tmp_path / "response.png").stat().st_size > 10_000
