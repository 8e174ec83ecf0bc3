"""`colcon test` starts pytest in the folder of a package, whose tests lie in `tests`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from conftest import PACKAGES, files_of

ROOT = Path(__file__).parents[2]


def test_each_test_belongs_to_one_package_and_each_package_has_some() -> None:
    files = [file for package in PACKAGES for file in files_of(package)]
    assert sorted(files) == sorted([*ROOT.glob("tests/unit/test_*.py"), *ROOT.glob("tests/graph/test_*.py")])
    assert all(files_of(package) for package in PACKAGES)
    manifests = [*ROOT.glob("amb_*/package.xml"), *ROOT.glob("src/*/package.xml")]
    assert set(PACKAGES) == {path.parent.name for path in manifests}


@pytest.mark.parametrize(
    ("place", "asked"),
    [(ROOT / "src" / "amb_ros", []), (ROOT / "build", [ROOT / "amb_msgs"])],  # colcon and CTest start it so
    ids=["Python", "CMake"],
)
def test_pytest_on_the_folder_of_a_package_collects_its_tests(place: Path, asked: list[Path]) -> None:
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", *map(str, asked)]
    shown = subprocess.run(command, cwd=place, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stdout
    collected = {(place / line.split("::")[0]).resolve() for line in shown.stdout.splitlines() if "::" in line}
    (package,) = asked or [place]
    assert {path.name for path in collected} == {path.name for path in files_of(package.name)}


def test_a_package_of_cmake_has_its_tests_run_by_ctest() -> None:
    listed = (ROOT / "build" / "amb_msgs" / "CTestTestfile.cmake").read_text()
    assert f'"pytest" "{ROOT / "amb_msgs"}"' in listed
