"""Data files of others, in odd shapes: each is identified with the right poles, or refused with the option that helps.

The files are made by `tests/data/own_data/make.py`, whose loop has known poles.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

from amb_core.ground.errors import AmbError
from amb_core.identification import StateSpaceModel

FOLDER = Path(__file__).parents[2] / "data" / "own_data"
POLE = float(np.sqrt(3.3e5 / 6.25))
"""Unstable pole of the loop in the files (1/s); the stable one is its negative."""
TOLERANCE = 0.03
"""Relative error allowed in each pole: the records are 0.05 to 0.15 s long."""
NONE = ("--controller", "none")


@dataclass(frozen=True)
class Case:
    """A file with the options that a user gives, and the option that a refusal must name; identified without one."""

    file: str
    options: tuple[str, ...] = ()
    helps: str = ""
    axes: int = 1

    @property
    def name(self) -> str:
        """For lists."""
        return f"{self.file} {' '.join(self.options)}".strip()


CASES = (
    Case("excel_de.csv", ("--inputs", "Strom X,Strom Y", "--outputs", "Lage X,Lage Y", *NONE), axes=2),
    Case("excel_de.csv", (), "--inputs"),
    Case("units_row.tsv", ("--inputs", "coil", "--outputs", "gap", *NONE)),
    Case("no_header.csv", ("--time", "0", "--inputs", "1", "--outputs", "2", "--units", "um,A", *NONE)),
    Case("oscilloscope.csv", ("--controller", "pd:20000,38")),
    Case("oscilloscope.csv", (), "--controller"),
    Case("spaces.dat", ("--inputs", "current", "--outputs", "position", "--rate", "8000", "--units", "mm,A", *NONE)),
    Case("spaces.dat", ("--inputs", "current", "--outputs", "position"), "--rate"),
    Case("french.csv", ("--inputs", "Courant", "--outputs", "Déplacement", *NONE)),
    Case("japanese.txt", ("--inputs", "電流", "--outputs", "変位", *NONE)),
    Case("mil.csv", NONE),
    Case("truncated.csv", NONE),
    Case("with_reference.csv", ("--controller", "pd:20000,38")),
    Case("odd_rate.csv", ("--inputs", "drive", "--outputs", "probe", *NONE)),
    Case("missing_rows.csv", NONE),
    Case("holes.csv", NONE, "--repair split"),
    Case("holes.csv", ("--repair", "split", *NONE)),
    Case("slow_gauge.csv", NONE, "only every 4. row has all"),
    Case("suffixes.csv", NONE),
    Case("jitter.csv", NONE, "--time none --rate"),
    Case("jitter.csv", ("--time", "none", "--rate", "8000", *NONE)),
    Case("variable_step.csv", NONE, "--repair resample"),
    Case("variable_step.csv", ("--repair", "resample", *NONE)),
    Case("jitter.csv", ("--repair", "resample", *NONE), "--time none --rate"),
    Case("comma_comma.csv", ("--rate", "8000"), "--separator"),
    Case("counter.csv", NONE, "--time none --rate"),
    Case("counter.csv", ("--time", "none", "--rate", "8000", *NONE)),
    Case("no_units.csv", ("--controller", "pd:20000,38"), "--units"),
    Case("no_units.csv", ("--units", "um,A", "--controller", "pd:20000,38")),
    Case("letter.txt", (), "--separator"),
    Case("matrix_v5.mat", ("--inputs", "0-1", "--outputs", "2-3", "--units", "m,A", *NONE), axes=2),
    Case("matrix_v5.mat", (), "--inputs"),
    Case("struct_v5.mat", ("--variable", "rig", "--units", "m,A", *NONE), axes=2),
    Case("v73.mat", ("--units", "um,A", *NONE), axes=2),
    Case("arrays.npz", ("--units", "um,mA", *NONE), axes=2),
    Case("rows.npy", ("--inputs", "0,1", "--outputs", "2,3", "--rate", "6400", *NONE), axes=2),
    Case("log.parquet", ("--inputs", "amp1,amp2", "--outputs", "probe1,probe2", *NONE), axes=2),
    Case("multi_array", ("--inputs", "data[0],data[1]", "--outputs", "data[2],data[3]", "--units", "um,A",
         *NONE), axes=2),
    Case("multi_array", (), "--inputs"),
    Case("joint_states", ("--inputs", "effort[x],effort[y]", "--outputs", "position[x],position[y]", "--units", "m,A",
         *NONE), axes=2),
    Case("scalars", ("--topics", "/coil/current,/rotor/position", "--inputs", "/coil/current.data", "--outputs",
         "/rotor/position.data", "--units", "um,A", *NONE)),
    Case("scalars", (), "--topics"),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What `amb identify` made of a case: a model, a refusal, or a traceback."""

    model: StateSpaceModel | None
    shown: str
    refusal: str
    traceback: str


def attempt(case: Case) -> Outcome:
    """Run `amb identify` on a case."""
    from amb_bringup.cli import app

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "model.json"
        words = ["identify", str(FOLDER / case.file), *case.options, "--order", str(2 * case.axes), "--out", str(out)]
        result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
        problem = result.exception
        if isinstance(problem, AmbError):
            return Outcome(None, result.output, str(problem), "")
        if problem is not None and not isinstance(problem, SystemExit):
            return Outcome(None, result.output, "", f"{type(problem).__name__}: {problem}")
        return Outcome(StateSpaceModel.load(out) if out.exists() else None, result.output, "", "")


def pole_error(model: StateSpaceModel) -> float:
    """Largest relative error of the poles of a model: as many at plus as at minus `POLE`."""
    rates = np.sort(np.real(np.log(model.poles()) / model.sample_time))
    right = np.sort(np.tile([-POLE, POLE], model.order // 2))
    return float(np.max(np.abs(rates - right)) / POLE)


def measure(cases: int = len(CASES)) -> dict[str, Any]:
    """Outcomes of all cases: tried, identified with the right poles, refused with help, and tracebacks."""
    counts = {"tried": 0, "identified": 0, "refused_with_help": 0, "tracebacks": 0}
    for case in CASES[:cases]:
        outcome = attempt(case)
        counts["tried"] += 1
        counts["tracebacks"] += bool(outcome.traceback)
        counts["identified"] += outcome.model is not None and not case.helps and pole_error(outcome.model) < TOLERANCE
        counts["refused_with_help"] += bool(case.helps and re.search(re.escape(case.helps), outcome.refusal))
    return counts
