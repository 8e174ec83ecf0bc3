"""What a package imports stands in its package.xml, and nothing else does."""

from __future__ import annotations

import ast
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PACKAGES = [path.parent for path in sorted([*ROOT.glob("amb_*/setup.py"), *ROOT.glob("src/amb_*/setup.py")])]
ROSDEP_KEYS = {
    "h5py": "python3-h5py",
    "jinja2": "python3-jinja2",
    "markupsafe": "python3-markupsafe",
    "matplotlib": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "tornado": "python3-tornado",
    "typer": "python3-typer",
    "yaml": "python3-yaml",
}
FROM_PYPI = {
    *("control", "ctrlsys", "dask", "distributed", "mcap", "plotly", "pyarrow", "pydantic", "threadpoolctl"),
    "zstandard",
}
DISTRIBUTIONS = {"yaml": "pyyaml"}  # names on PyPI that differ from those of the modules
NOT_IMPORTED = {"amb_ident_node", "launch_ros", "launch_yaml"}  # what launch files need, dependencies of amb_bringup


def imported(package: Path) -> set[str]:
    """Top-level modules from outside the package and the standard library."""
    names: set[str] = set()
    for path in (package / package.name).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.split(".")[0])
    return names - set(sys.stdlib_module_names) - {package.name}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_imports_are_dependencies_and_dependencies_are_imported(package: Path) -> None:
    manifest = ElementTree.parse(package / "package.xml").getroot()
    declared = {item.text for tag in ("depend", "exec_depend") for item in manifest.findall(tag)}
    needed = {ROSDEP_KEYS.get(name, name) for name in imported(package) - FROM_PYPI}
    assert declared - NOT_IMPORTED == needed - NOT_IMPORTED


def test_amb_core_asks_pip_for_what_it_imports_at_versions_that_are_tested() -> None:
    script = ast.parse((ROOT / "src" / "amb_core" / "setup.py").read_text())
    (listed,) = (
        node.value
        for node in script.body
        if isinstance(node, ast.Assign)
        and [name.id for name in node.targets if isinstance(name, ast.Name)] == ["REQUIRED"]
    )
    required = {item.name.lower(): item for item in map(Requirement, ast.literal_eval(listed))}
    assert set(required) == {DISTRIBUTIONS.get(name, name) for name in imported(ROOT / "src" / "amb_core")}
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    pinned = dict(line.split("#")[0].split(";")[0].strip().lower().split("==") for line in lines if "==" in line)
    assert not {name: pinned[name] for name, item in required.items() if pinned[name] not in item.specifier}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_what_has_no_rosdep_key_is_named_and_pinned(package: Path) -> None:
    text = (package / "package.xml").read_text()
    pinned = {line.split("==")[0] for line in (ROOT / "requirements.txt").read_text().splitlines()}
    for name in imported(package) & FROM_PYPI:
        assert name in text
        assert name in pinned
