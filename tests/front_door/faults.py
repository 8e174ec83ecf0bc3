"""Plants faults, one at a time, in a copy of the checkout, and shows that `make quick` or its test is red for each.

`python -m tests.front_door.faults` writes results/faults.json: what was run for each fault, whether it was red, and the
line that says so. Before, each check must be green in the copy without a fault.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.front_door.figures import Figures
from tests.front_door.results import ROOT, results_file

PACKAGES = (
    *("src/amb_core", "src/amb_ros", "src/amb_bringup", "src/amb_paper"),
    *("amb_sim_node", "amb_controller_node", "amb_ident_node"),
)
LIST = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/unit/test_front_door.py")
VALIDATION = ("-m", "tests.front_door.run", "tests.validation.run")
TARGET_FUZZ = ("-m", "tests.front_door.run", "tests.fuzz.target")
ROBUST = ("-m", "tests.front_door.run", "tests.benchmarks.robust.run")
FIRST_HOUR = ("-m", "tests.front_door.run", "tests.benchmarks.first_hour.run")
MODES = ("-m", "tests.front_door.commands", "--only", "amb plant modes")


@dataclass(frozen=True)
class Fault:
    """A change of one file that breaks something, what is run, and what its output must say."""

    name: str
    file: str
    old: str
    new: str
    check: tuple[str, ...]
    says: str


FAULTS = (
    Fault(
        "a law of two axes meets a rotor of four", "tests/validation/dynamics.py",
        "PdController(ControllerParameters(), axes)", "PdController(ControllerParameters())", VALIDATION,
        "could not broadcast",
    ),
    Fault(
        "an argument that one program names is renamed", "src/amb_core/amb_core/robustness/sweep.py",
        "sweep_duration", "duration_of_sweep", ROBUST, "sweep_duration",
    ),
    Fault(
        "a part returns nothing", "tests/benchmarks/first_hour/new.py",
        '    return {\n        "bearings"', '    _ = {\n        "bearings"', FIRST_HOUR, "new: Input should be",
    ),
    Fault(
        "a key disappears", "tests/fuzz/target.py", '"states": states, "findings"', '"findings"', TARGET_FUZZ,
        "states: Field required",
    ),
    Fault(
        "a key is misspelt", "tests/fuzz/target.py", '"seed": seed, "seconds"', '"sead": seed, "seconds"', TARGET_FUZZ,
        "sead: Extra inputs are not permitted",
    ),
    Fault(
        "a check loses a row", "tests/validation/paper.py", '    yield Row("sag', '    _ = Row("sag', VALIDATION,
        "has 2 rows; declared: 3",
    ),
    Fault(
        "a program writes no results", "tests/validation/run.py", "    results.keep_all(", "    str(", VALIDATION,
        "validation.json: [Errno 2]",
    ),
    Fault(
        "the import of a command fails", "src/amb_bringup/amb_bringup/commands/plant_modes.py",
        "from __future__ import annotations\n", "from __future__ import annotations\n\nimport no_such_module\n", MODES,
        "No module named 'no_such_module'",
    ),
    Fault(
        "a target is not on the list", "Makefile", "clean:  ##", "polish:  ## shine\n\t@true\n\nclean:  ##", LIST,
        "test_every_target_is_listed",
    ),
    Fault(
        "a command is not on the list", "src/amb_bringup/amb_bringup/cli.py", '    "plant": (',
        '    "planet": ("tune:app", "Suggest PD gains."),\n    "plant": (', LIST, "test_every_command_is_listed",
    ),
    Fault(
        "a part is not on the list", "tests/front_door/entries.py", '"recovery", ', "", LIST,
        "test_every_module_beside_a_program_is_listed",
    ),
    Fault(
        "a function of a part is not called", "tests/soak/parts.py", "def _patiently",
        "def heat_up(folder):\n    return {}\n\n\ndef _patiently", LIST, "test_every_function_of_a_part_is_called",
    ),
    Fault(
        "a target starts another program than listed", "Makefile", "python -m tests.validation.run",
        "python -m tests.validation.main", LIST, "test_the_targets_run_the_programs_that_are_listed",
    ),
)  # fmt: skip


class FaultFound(Figures):
    """What came of a fault."""

    fault: str
    run: str
    red: bool
    line: str


def main() -> int:
    """Plant the faults; 1 if one is not seen, or a check is red without one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--without-control", action="store_true", help="leave out the runs without a fault")
    names = [fault.name for fault in FAULTS]
    parser.add_argument("names", nargs="*", choices=[*names, []], help="faults to plant; default: all")
    chosen = parser.parse_args()
    faults = [fault for fault in FAULTS if not chosen.names or fault.name in chosen.names]
    with tempfile.TemporaryDirectory(prefix="faults") as folder:
        copy = copied(Path(folder) / "checkout")
        if not chosen.without_control:
            for check in dict.fromkeys(fault.check for fault in faults):
                red, output = run(copy, check)
                print(f"{'RED' if red else 'green'} without a fault: {' '.join(check[1:])}", flush=True)
                if red:
                    print(output[-3000:])
                    return 1
        outcomes = [look(copy, fault) for fault in faults]
    results_file("faults.json").write_text(json.dumps([item.model_dump() for item in outcomes], indent=1) + "\n")
    seen = sum(item.red for item in outcomes)
    print(f"{seen} of {len(outcomes)} faults are seen")
    return 0 if seen == len(outcomes) else 1


def copied(folder: Path) -> Path:
    """A copy of what git knows of this checkout, as it is now, and of the kernels that are compiled for it."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    compiled = [str(path.relative_to(ROOT)) for pattern in ("*.nbi", "*.nbc") for path in ROOT.rglob(pattern)]
    for name in [*names.split("\0"), *compiled]:
        if (ROOT / name).is_file() or (ROOT / name).is_symlink():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)  # one leads to the folder target
    return folder


def run(copy: Path, check: tuple[str, ...]) -> tuple[bool, str]:
    """Whether a check is red in the copy, and what it shows."""
    path = os.pathsep.join([str(copy), *(str(copy / package) for package in PACKAGES), os.environ["PYTHONPATH"]])
    done = subprocess.run(
        [sys.executable, *check], cwd=copy, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    return done.returncode != 0, done.stdout + done.stderr


def look(copy: Path, fault: Fault) -> FaultFound:
    """Plant a fault, run its check, and take the fault away."""
    file = copy / fault.file
    text, when = file.read_text(), file.stat()
    if fault.old not in text:
        raise RuntimeError(f"{fault.name}: {fault.file} has no {fault.old!r}")
    file.write_text(text.replace(fault.old, fault.new))
    try:
        red, output = run(copy, fault.check)
    finally:
        file.write_text(text)
        os.utime(file, ns=(when.st_atime_ns, when.st_mtime_ns))  # so that what was compiled of it counts
    line = next((line.strip() for line in output.splitlines() if fault.says in line), "")
    outcome = FaultFound(fault=fault.name, run=" ".join(fault.check[1:]), red=red and bool(line), line=line[:300])
    print(f"{'red' if outcome.red else 'NOT SEEN'}: {fault.name}: {outcome.line or output[-1500:]}", flush=True)
    return outcome


if __name__ == "__main__":
    sys.exit(main())
