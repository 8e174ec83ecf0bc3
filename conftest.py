"""Which tests `colcon test` runs for a package: those in `tests` that name it, and no package above it.

colcon starts pytest in the folder of the package, which has no tests of its own.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent
PACKAGES = (  # upwards
    *("amb_msgs", "amb_core", "amb_ros", "amb_controller_node", "amb_sim_node", "amb_ident_node", "amb_bringup"),
    "amb_paper",
)


def files_of(package: str) -> list[Path]:
    """The files; those that name no package belong to the highest one."""
    files = sorted([*(ROOT / "tests" / "unit").glob("test_*.py"), *(ROOT / "tests" / "graph").glob("test_*.py")])
    return [file for file in files if _highest(file) == package]


def _highest(file: Path) -> str:
    named = set(re.findall(r"\bamb_[a-z_]+", file.read_text()))
    return next((name for name in reversed(PACKAGES) if name in named), PACKAGES[-1])


def pytest_configure(config: pytest.Config) -> None:
    """In the folder of a package, run its tests."""
    asked = [Path(one).resolve() for one in config.args]
    if len(asked) == 1 and asked[0].name in PACKAGES and (asked[0] / "package.xml").is_file():
        config.args[:] = map(str, files_of(asked[0].name))
        config.option.markexpr = config.option.markexpr or "not slow"
