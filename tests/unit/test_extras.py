"""Optional parts: the six nodes start without them, and where one is missing one line names its extra."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

CORE = Path(__file__).parents[2] / "src" / "amb_core"

EXTRAS = (
    "amb_core.report.pages",
    "amb_core.report.figures",
    "amb_core.recording.export",
    "amb_core.ground.tasks.cluster",
    "amb_core.ground.tasks.pool",
)
PACKAGES = (  # of the extras, and of the command line
    *("control", "dask", "distributed", "foxglove", "h5py", "jinja2", "markupsafe", "matplotlib", "plotly", "pyarrow"),
    *("rich", "ross", "tornado", "typer"),
)
RIG = (
    "amb_core.rig",
    "amb_core.rig.link",
    "amb_core.rig.emulation",
    "amb_core.rig.commissioning",
    "amb_core.rig.machine_experiment",
)
CERTIFICATE = ("amb_core.robustness",)
NODES = (
    "amb_sim_node.simulator",
    "amb_controller_node.pd_controller",
    "amb_controller_node.excitation_generator",
    "amb_ident_node.region_monitor",
    "amb_ident_node.recorder",
    "amb_ident_node.identifier",
)
OPTIONAL = (*EXTRAS, *PACKAGES, *RIG, *CERTIFICATE, "amb_bringup")

WITHOUT = """
import sys


class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in {names!r}:
            raise ModuleNotFoundError(f"No module named '{{name}}'", name=name)


sys.meta_path.insert(0, Missing())
"""


def run_without(names: tuple[str, ...], code: str) -> str:
    """What a process prints in which these modules are not installed."""
    with tempfile.TemporaryDirectory() as folder:  # for the processes that it starts, too
        Path(folder, "sitecustomize.py").write_text(WITHOUT.format(names=set(names)))
        path = os.pathsep.join(filter(None, (folder, os.environ.get("PYTHONPATH"))))
        done = subprocess.run(
            [sys.executable, "-c", f"import sys\n{code}"],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
        )
    assert done.returncode == 0, done.stderr[-2_000:]
    return done.stdout


@pytest.mark.parametrize("module", NODES)
def test_a_node_starts_without_the_optional_parts(module: str) -> None:
    loaded = run_without(PACKAGES, f"import {module}\nprint([name for name in {OPTIONAL!r} if name in sys.modules])")
    assert loaded.strip() == "[]"


NEEDING = {  # an extra: what needs it
    "'cluster' of amb_core": ("import amb_core.ground.tasks.cluster", "import amb_core.ground.tasks.pool"),
    "'control' of amb_core": ("from amb_core.linear import *; LinearSystem(*4 * [[[0.0]]], 1e-4).to_control()",),
    "'figures' of amb_core": (
        "import amb_core.report.figures.chart",
        "import amb_core.report.pages",
        "import amb_core.plant.figures",
    ),
    "'files' of amb_core": (
        "import amb_core.recording.export.model_texts",
        "from amb_core.data.tables.parquet import *; read_parquet_table('x')",
        "from amb_core.ground.files.matlab import _load_hdf5; _load_hdf5('x')",
    ),
    "'view' of amb_bringup": ("import amb_bringup.view.server",),
}


def test_one_line_names_the_extra_of_a_missing_package() -> None:
    attempts = """
from amb_core.ground.errors import AmbError

for code in {codes!r}:
    try:
        exec(code)
    except AmbError as problem:
        print(problem)
"""
    lines = run_without(PACKAGES, attempts.format(codes=[code for codes in NEEDING.values() for code in codes]))
    named = [extra for extra, codes in NEEDING.items() for _ in codes]
    for line, extra in zip(lines.splitlines(), named, strict=True):
        assert f"is not installed; it belongs to the extra {extra}: pip install " in line


def test_a_command_without_its_extra_ends_with_that_line() -> None:
    code = "import amb_bringup.cli\nsys.argv = ['amb', 'view']\nprint(amb_bringup.cli.main())"
    assert run_without(("tornado",), code).strip() == "1"


def test_foxglove_without_its_extra_says_in_one_line_what_to_install() -> None:
    code = "import amb_bringup.cli\nsys.argv = ['amb', 'foxglove', '--port', '0']\nsys.stderr = sys.stdout\n"
    shown = run_without(("foxglove",), f"{code}print(amb_bringup.cli.main())")
    assert shown == "amb: foxglove-sdk is not installed; add it with make setup EXTRAS=foxglove\n1\n"


def test_the_command_of_a_package_that_is_not_built_names_it() -> None:
    code = """
from typer.testing import CliRunner

from amb_bringup.cli import app

print(CliRunner().invoke(app, ["reproduce"]).exception)
"""
    shown = run_without(("amb_paper",), code).strip()
    assert shown == "'amb reproduce' belongs to the package 'amb_paper', which is not found; build it (make setup)"


@pytest.mark.slow
def test_a_model_is_identified_from_a_simulated_experiment_without_the_optional_parts() -> None:
    example = re.findall(r"^```python\n(.*?)^```$", (CORE / "README.md").read_text(), re.DOTALL | re.MULTILINE)[0]
    assert "2 unstable plant poles" in run_without(PACKAGES, example.replace("result.model.save", "#"))
