"""One version: `amb_core.__version__`, in packages, pages, bags, certificates, documentation and command line."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core import __version__
from amb_core.recording import mcap_file
from amb_core.report.pages import Report, write_report
from amb_core.robustness.trace import made_now

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    path
    for folder in ("src", "amb_sim_node", "amb_controller_node", "amb_ident_node", "docs", "scripts")
    for path in (ROOT / folder).rglob("*.py")
    if "build" not in path.parts
)


def test_the_command_line_shows_it() -> None:
    assert CliRunner().invoke(app, ["--version"]).output == f"amb {__version__}\n"


def test_bags_pages_and_certificates_name_it(tmp_path: Path) -> None:
    assert f"amb_core {__version__}" == mcap_file.PROGRAM
    write_report(Report("A page", "Nothing.", [], []), tmp_path / "page.html")
    assert f"amb_core {__version__}" in (tmp_path / "page.html").read_text()
    assert made_now()["version"] == __version__


def test_the_documentation_has_it() -> None:
    settings = runpy.run_path(str(ROOT / "docs" / "conf.py"))
    assert settings["release"] == settings["version"] == __version__


def test_only_the_library_and_the_manifests_state_it() -> None:
    """A second place would be forgotten; what is installed may be older than the code that runs."""
    stating = {str(path.relative_to(ROOT)) for path in SOURCES if f'"{__version__}"' in path.read_text()}
    manifests = {name for name in stating if name.endswith("/setup.py")}  # test_package_manifests compares these
    assert stating - manifests == {"src/amb_core/amb_core/ground/version.py"}
    asking = re.compile(r"\bversion(?:_of)?\([\"']amb_")
    assert not [path for path in SOURCES if asking.search(path.read_text())]
