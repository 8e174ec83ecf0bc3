"""A program of several subjects, each a module with `measure() -> dict`: what such programs share.

Prints a table and writes a file of results, each subject as soon as it is measured; subjects of earlier runs that a run
does not measure are kept.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.front_door.results import ROOT, Results

_SHOWN = 12  # figures of a subject in the table


def run_subjects(package: str, subjects: Mapping[str, Mapping[str, Any]], results: str, description: str) -> None:
    """Measure the subjects that the command line names, by default all, and report.

    Parameters
    ----------
    package : str
        Of the subjects' modules.
    subjects : mapping
        Smallest size of each by name, with which `--quick` calls `measure`.
    results : str
        Name of the file of results.
    description : str
        For the help.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subjects", nargs="*", choices=[*subjects, []], help="subjects to measure; default: all")
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    arguments = parser.parse_args()
    measured, console = Results(results, arguments.quick), Console()
    table = Table("subject", "figures", "seconds", title=measured.file.stem)
    for name in arguments.subjects or subjects:
        began = time.monotonic()
        with console.status(f"measuring {name}"):
            measure = importlib.import_module(f"{package}.{name}").measure
            values = measure(**subjects[name] if arguments.quick else {})
        measured.keep(name, {name: values})
        figures = [f"{key} {value}" for key, value in values.items() if not isinstance(value, dict | list)]
        table.add_row(name, ", ".join(figures[:_SHOWN]), f"{time.monotonic() - began:.0f}")
    if not arguments.subjects:
        measured.drop_others(subjects)
    console.print(table)
    console.print(f"written to {measured.file.relative_to(ROOT)}")
