"""A package declares what it imports: in package.xml for rosdep, in setup.py for pip, from tested versions onwards."""

from __future__ import annotations

import ast
import functools
import importlib.metadata
import re
import runpy
import sys
import sysconfig
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import setuptools  # brings distutils to Python 3.12
from catkin_pkg.package import parse_package
from packaging.requirements import Requirement
from setuptools.dist import Distribution

import amb_core

ROOT = Path(__file__).parents[2]
MANIFESTS = sorted([*ROOT.glob("amb_*/package.xml"), *ROOT.glob("src/amb_*/package.xml")])
FLOOR = "the pins are those of `make floor`"
of_our_pins = pytest.mark.skipif(not (ROOT / "requirements.hashes").exists(), reason=FLOOR)
REQUIREMENTS = [*sorted(ROOT.glob("requirements*.txt")), ROOT / "docs" / "requirements.txt"]
PACKAGES = [path.parent for path in MANIFESTS if (path.parent / "setup.py").exists()]
FROM_APT = {  # modules that rosdep installs in a version that is new enough, and its keys for them
    "h5py": "python3-h5py",
    "jinja2": "python3-jinja2",
    "markupsafe": "python3-jinja2",  # has no key; Jinja2 depends on it
    "matplotlib": "python3-matplotlib",
    "cryptography": "python3-cryptography",
    "numpy": "python3-numpy",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
    "tornado": "python3-tornado",
    "yaml": "python3-yaml",
}
FROM_PYPI = {
    *(
        "control",
        "ctrlsys",
        "dask",
        "distributed",
        "lz4",
        "mcap",
        "numba",
        "plotly",
        "psutil",
        "pyarrow",
        "pydantic",
        "rosbags",
    ),
    *("threadpoolctl", "typer", "zstandard"),
}
DISTRIBUTIONS = {"yaml": "pyyaml"}  # names on PyPI that differ from those of the modules
NOT_IMPORTED = {"amb_ident_node", "launch_ros", "launch_yaml"}  # what launch files need, dependencies of amb_bringup
LOADED_BY_OTHERS = {"cryptography"}  # by distributed, of which it is an optional part
LICENCES = runpy.run_path(str(ROOT / "scripts" / "licences.py"))
NOT_OF_THE_PACKAGES = {"all", "test", "ross", "foxglove"}  # extras of tests, of users' own code, and loaded by name


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


def manifest_of(package: Path) -> ElementTree.Element:
    return ElementTree.parse(package / "package.xml").getroot()


@functools.cache
def built(package: Path) -> Distribution:
    """What setup.py passes to setuptools."""
    passed: list[dict] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(package)
        patch.setattr(setuptools, "setup", lambda **arguments: passed.append(arguments))
        exec(compile(Path("setup.py").read_text(), str(package / "setup.py"), "exec"), {"__name__": "__main__"})
    return Distribution(passed[0])


def required(package: Path) -> dict[str, Requirement]:
    """By name: what pip installs with the package, its optional parts included."""
    extras = built(package).extras_require
    texts = [*built(package).install_requires]
    texts += [text for name, part in extras.items() if name not in NOT_OF_THE_PACKAGES for text in part]
    return {item.name.lower(): item for item in map(Requirement, texts)}


def pinned(*files: str) -> dict[str, str]:
    lines = [line for name in files for line in (ROOT / name).read_text().splitlines() if "==" in line]
    lines = [line for line in lines if 'python_version >= "3.12"' not in line]  # without a wheel of the oldest version
    return dict(line.split("#")[0].split(";")[0].strip().lower().split("==") for line in lines)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_imports_are_dependencies_and_dependencies_are_imported(package: Path) -> None:
    manifest = manifest_of(package)
    declared = {item.text for tag in ("depend", "exec_depend") for item in manifest.findall(tag)}
    needed = {FROM_APT.get(name, name) for name in imported(package) - FROM_PYPI}
    brought = {FROM_APT[name] for name in LOADED_BY_OTHERS & set(required(package))}
    assert declared - NOT_IMPORTED == (needed | brought) - NOT_IMPORTED


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_what_rosdep_does_not_install_is_named(package: Path) -> None:
    comment = re.search(r"<!-- From PyPI: ([^.;]*)", (package / "package.xml").read_text())
    named = set(re.findall(r"[a-z0-9]+", comment.group(1).partition(", which")[0])) if comment else set()
    assert named == imported(package) & FROM_PYPI


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_pip_is_asked_for_what_is_imported(package: Path) -> None:
    modules = imported(package) & (set(FROM_APT) | FROM_PYPI)
    assert set(required(package)) - LOADED_BY_OTHERS == {DISTRIBUTIONS.get(name, name) for name in modules}


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_the_versions_that_pip_may_take_begin_at_those_of_a_stock_jazzy_and_allow_ours(package: Path) -> None:
    oldest = pinned("scripts/stock-jazzy-apt.txt", "scripts/stock-jazzy-pip.txt")
    ours = pinned("requirements.txt")
    for name, item in required(package).items():
        assert ours[name] in item.specifier
        (floor,) = (one.version for one in item.specifier if one.operator == ">=")
        assert oldest[name] in item.specifier
        assert oldest[name].split(".")[: floor.count(".") + 1] == floor.split(".")


def test_what_the_packages_for_a_stock_jazzy_require_is_with_them_or_from_apt() -> None:
    """Of those that are installed here in that version: all of them under `make floor`."""
    normal = LICENCES["normal"]
    files = [ROOT / "scripts" / f"stock-jazzy-{source}.txt" for source in ("pip", "apt")]
    from_pypi, from_apt = (LICENCES["pins"](file) for file in files)
    there = {name: version for name, version in from_pypi.items() if _installed(name) == version}
    assert there
    for name in there:
        for needed in map(Requirement, importlib.metadata.requires(name) or []):
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                assert normal(needed.name) in from_pypi | from_apt, f"{name} requires {needed}"


def _installed(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


@of_our_pins
@pytest.mark.parametrize("requirements", REQUIREMENTS, ids=lambda path: f"{path.parent.stem}-{path.stem}")
def test_every_pin_has_the_hashes_of_its_files(requirements: Path) -> None:
    text = requirements.with_suffix(".hashes").read_text().replace(" \\\n", "")
    hashed = [line.split(" --hash=") for line in text.splitlines() if not line.startswith("#")]
    pins = [line.split("#")[0].strip() for line in requirements.read_text().splitlines()]
    assert [pin.strip() for pin, *_ in hashed] == [pin for pin in pins if pin], "run scripts/hash_requirements.py"
    assert all(
        digests and all(re.fullmatch("sha256:[0-9a-f]{64}", one.strip()) for one in digests) for _, *digests in hashed
    )


@of_our_pins
def test_the_pins_are_complete_as_set_up_installs_no_other_package() -> None:
    pins, normal = LICENCES["pins"](ROOT / "requirements.txt"), LICENCES["normal"]
    for name in pins:
        for text in importlib.metadata.requires(name) or []:
            needed = Requirement(text)
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                assert pins.get(normal(needed.name)) in needed.specifier, f"{name} requires {needed}"


def licences_of(requirements: Path) -> list[str]:
    """The rows of a file of pins in the list of licences."""
    part = LICENCES["PAGE"].read_text().split(f"## {requirements.relative_to(ROOT)}\n")[1].split("\n## ")[0]
    return [line for line in part.splitlines() if line.startswith("|")][2:]


@of_our_pins
@pytest.mark.parametrize("requirements", REQUIREMENTS, ids=lambda path: f"{path.parent.stem}-{path.stem}")
def test_the_licence_of_every_pin_is_listed(requirements: Path) -> None:
    listed = [[cell.strip() for cell in row.split("|")[1:-1]] for row in licences_of(requirements)]
    versions = {name: version for name, version, *_ in listed}
    assert versions == LICENCES["pins"](requirements), "run scripts/licences.py"
    for name, _, licence, reason in listed:
        assert reason or set(LICENCES["parts"](licence)) <= LICENCES["ALLOWED"], name


@of_our_pins
def test_the_licences_of_the_core_are_those_that_the_installed_packages_name() -> None:
    folder, share = Path(sysconfig.get_path("purelib")), Path(sys.prefix, "share")
    rows = LICENCES["rows"](ROOT / "requirements.txt", folder, share)
    assert [f"| {' | '.join(row)} |" for row in rows] == licences_of(ROOT / "requirements.txt")


def test_all_extras_together_have_a_name() -> None:
    extras = built(ROOT / "src" / "amb_core").extras_require
    assert set(extras["all"]) == {text for name in extras.keys() - NOT_OF_THE_PACKAGES for text in extras[name]}


def test_the_guide_says_for_what_each_package_is_needed_and_from_where_it_comes() -> None:
    guide = (ROOT / "docs" / "how-to" / "install.md").read_text()
    rows = re.findall(r"^\| ([\w, -]+) \| ([\w ]+) \| (apt|PyPI) \|", guide, re.MULTILINE)
    listed = {name.lower(): (part, source) for names, part, source in rows for name in names.split(", ")}
    needed = {}
    for name in {name for package in PACKAGES for name in required(package)}:
        parts = {
            "core" if part is None else part
            for package in PACKAGES
            for part, texts in {None: built(package).install_requires, **built(package).extras_require}.items()
            if part not in NOT_OF_THE_PACKAGES and name in {Requirement(text).name.lower() for text in texts}
        }
        module = next((module for module, known in DISTRIBUTIONS.items() if known == name), name)
        needed[name] = (" and ".join(sorted(parts)), "apt" if module in FROM_APT else "PyPI")
    assert listed == needed


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.parent.name)
def test_colcon_takes_the_manifest(path: Path) -> None:
    """It builds a package with a manifest that it refuses as one of Python only, which ROS does not find."""
    parse_package(path)


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.parent.name)
def test_packages_have_one_version_one_licence_and_one_address(path: Path) -> None:
    manifest, package = ElementTree.parse(path).getroot(), path.parent
    value = {item.tag: item.text for item in manifest}
    assert value["version"] == amb_core.__version__
    assert f"## [{value['version']}]" in (ROOT / "CHANGELOG.md").read_text()
    assert f"\n{value['version']}\n-----\n" in (package / "CHANGELOG.rst").read_text()
    assert (package / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    core = {item.tag: item.text for item in manifest_of(ROOT / "src" / "amb_core")}
    assert all(value[tag] == core[tag] for tag in ("version", "license", "url", "maintainer"))
    if package in PACKAGES:
        made = built(package).metadata
        assert (made.name, made.version, made.description) == (value["name"], value["version"], value["description"])
        assert (made.license, made.url, made.maintainer) == (value["license"], value["url"], value["maintainer"])
        assert {item.text for item in manifest.findall("test_depend")} == {
            f"python3-{name}" for name in built(package).extras_require["test"]
        }
