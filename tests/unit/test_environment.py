"""`source scripts/env.sh` and set-up: the packages of this checkout come first, whatever the environment holds."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "scripts" / "env.sh"
WHICH = 'command -v python; python -c "import amb_core, rclpy; print(amb_core.__file__, rclpy.__file__, sep=chr(10))"'


def bash(command: str, *options: str, script: Path = SCRIPT, **environment: str) -> subprocess.CompletedProcess[str]:
    """A command of bash after sourcing, in an environment with these variables too."""
    return subprocess.run(
        ["bash", *options, "-c", f'source "{script}"; {command}'],
        env=os.environ | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def checkout(folder: Path, made_for: Path | None = None) -> Path:
    """A checkout without packages, set up in this folder or another; its script."""
    for part in ("scripts", "install/amb_bringup/bin", ".venv/bin"):
        (folder / part).mkdir(parents=True)
    (folder / "install" / "local_setup.bash").write_text(f'PATH="{folder}/install/amb_bringup/bin:$PATH"\n')
    (folder / ".venv" / ".root").write_text(f"{made_for or folder}\n")
    return Path(shutil.copy(SCRIPT, folder / "scripts"))


def test_another_ros_is_left_out(tmp_path: Path) -> None:
    for package in ("rclpy", "amb_core"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("raise RuntimeError('another one')\n")
    result = bash(
        WHICH, PYTHONPATH=str(tmp_path), AMENT_PREFIX_PATH="/opt/ros/jazzy", COLCON_CURRENT_PREFIX="/opt/ros/jazzy"
    )
    assert result.returncode == 0, result.stderr
    assert all(line.startswith(f"{ROOT}/") for line in result.stdout.splitlines())


def test_the_checkout_that_is_sourced_last_comes_first(tmp_path: Path) -> None:
    other = checkout(tmp_path)
    result = bash(f'source "{other}"; echo $PATH; source "{SCRIPT}"; echo $PATH')
    first, last = (line.split(":")[:2] for line in result.stdout.splitlines())
    assert first == [f"{tmp_path}/install/amb_bringup/bin", f"{tmp_path}/.venv/bin"], result.stderr
    assert last == [f"{ROOT}/install/amb_bringup/bin", f"{ROOT}/.venv/bin"]


def test_an_environment_that_was_activated_since_is_put_behind() -> None:
    result = bash(f'PATH=/other/bin:$PATH; source "{SCRIPT}"; echo $PATH')
    folders = result.stdout.strip().split(":")
    assert folders.index(f"{ROOT}/.venv/bin") < folders.index("/other/bin")
    assert folders.count(f"{ROOT}/.venv/bin") == 1


def test_sourcing_twice_changes_nothing() -> None:
    once, twice = (bash(f"{more} env | sort | grep -v '^_='").stdout for more in ("", f'source "{SCRIPT}";'))
    assert once == twice and "AMENT_PREFIX_PATH" in once


def test_folders_that_cd_looks_through_do_not_matter(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    command = ["bash", "-c", "CDPATH=.:$1; source scripts/env.sh; command -v amb", "bash", str(tmp_path)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.stdout.strip() == f"{ROOT}/install/amb_bringup/bin/amb", result.stderr


def test_a_shell_that_refuses_unset_variables_goes_on_and_still_refuses_them() -> None:
    result = bash("echo on; echo $not_set; echo further", "-u")
    assert result.stdout == "on\n" and "not_set: unbound variable" in result.stderr


def test_a_checkout_that_was_moved_says_so(tmp_path: Path) -> None:
    result = bash("echo code $?", script=checkout(tmp_path / "here", made_for=tmp_path / "there"))
    assert result.stdout == "code 1\n"
    assert result.stderr == f"env.sh: the checkout was moved to {tmp_path / 'here'}; run: make setup\n"


@pytest.mark.skipif(shutil.which("dash") is None, reason="there is no dash")
def test_another_shell_is_named() -> None:
    result = subprocess.run(["dash", "-c", f'. "{SCRIPT}"'], capture_output=True, text=True, check=False)
    assert result.stderr == "env.sh: this shell is not bash; start one with: bash\n"


def test_the_only_middleware_of_the_wheels_is_taken() -> None:
    assert bash("echo $RMW_IMPLEMENTATION", RMW_IMPLEMENTATION="rmw_cyclonedds_cpp").stdout == "rmw_fastrtps_cpp\n"


def test_a_python_that_is_named_after_set_up_is_not_passed_over() -> None:
    named = os.environ | {"AMB_PYTHON": "/nowhere/python3.12"}
    setup = subprocess.run(
        ["bash", str(ROOT / "scripts" / "setup.sh")], env=named, capture_output=True, text=True, check=False
    )
    assert setup.returncode == 1
    assert "AMB_PYTHON is /nowhere/python3.12, but .venv was made from" in setup.stderr
