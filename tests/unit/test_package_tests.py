"""`colcon test` starts pytest in the folder of a package, whose tests lie in `tests`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from conftest import PACKAGES, files_of

ROOT = Path(__file__).parents[2]


def test_each_test_belongs_to_one_package_and_each_package_has_some() -> None:
    files = [file for package in PACKAGES for file in files_of(package)]
    assert sorted(files) == sorted([*ROOT.glob("tests/unit/test_*.py"), *ROOT.glob("tests/graph/test_*.py")])
    assert all(files_of(package) for package in PACKAGES)
    assert set(PACKAGES) == {path.parent.name for path in [*ROOT.glob("amb_*/setup.py"), *ROOT.glob("src/*/setup.py")]}


def test_pytest_in_the_folder_of_a_package_collects_its_tests() -> None:
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    shown = subprocess.run(command, cwd=ROOT / "src" / "amb_ros", capture_output=True, text=True)
    assert shown.returncode == 0
    collected = {line.split("::")[0] for line in shown.stdout.splitlines() if "::" in line}
    assert collected == {str(path.relative_to(ROOT)) for path in files_of("amb_ros")}
