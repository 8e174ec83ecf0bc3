"""Files of others in every command that takes data: the same options, a saved description for the next file, and a
refusal in one line, with the option that helps, where a command needs more than the file has."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.errors import AmbError
from amb_core.identification import StateSpaceModel
from tests.benchmarks.first_hour.files import CASES, FOLDER, Case

FILES = {case.file: case for case in CASES if not case.helps}
"""One case for each file that can be identified."""
WITH_REFERENCE = ("with_reference.csv", "oscilloscope.csv", "struct_v5.mat")
NOT_VALIDATED = 3  # exit code


def amb(*words: object) -> tuple[int, str]:
    """Exit code and text of a command; an error that is not meant for users is raised."""
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"})
    problem = result.exception
    if isinstance(problem, AmbError):
        assert "\n" not in str(problem)
        return 1, str(problem)
    if problem is not None and not isinstance(problem, SystemExit):
        raise problem
    return result.exit_code, result.output


def identified(case: Case, folder: Path) -> Path:
    """The model of a file; its description is saved as `my_rig.yaml`."""
    saving = ("--save-description", folder / "my_rig.yaml")
    code, shown = amb(
        "identify", FOLDER / case.file, *case.options, "--order", 2 * case.axes, "--out", folder / "model.json", *saving
    )
    assert code == 0, shown
    return folder / "model.json"


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_a_saved_description_reads_the_next_file_without_a_question(case: Case, tmp_path: Path) -> None:
    first = StateSpaceModel.load(identified(case, tmp_path))
    following = tmp_path / f"next_{Path(case.file).name}"
    (shutil.copytree if (FOLDER / case.file).is_dir() else shutil.copy)(FOLDER / case.file, following)
    known = ("--description", tmp_path / "my_rig.yaml")
    code, shown = amb("identify", following, *known, "--order", first.order, "--out", tmp_path / "again.json")
    assert code == 0, shown
    again = StateSpaceModel.load(tmp_path / "again.json")
    assert again.a.tobytes() == first.a.tobytes()
    assert (again.input_names, again.output_names) == (first.input_names, first.output_names)
    assert (again.input_units, again.output_units) == (first.input_units, first.output_units)


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_validate_and_compare_take_the_same_options(case: Case, tmp_path: Path) -> None:
    model, data = identified(case, tmp_path), FOLDER / case.file
    code, shown = amb(
        "validate", model, data, "--description", tmp_path / "my_rig.yaml", "--results", tmp_path / "v.json"
    )
    assert code in (0, NOT_VALIDATED), shown
    judged = json.loads((tmp_path / "v.json").read_text())
    code, shown = amb("compare", model, data, *case.options, "--results", tmp_path / "c.json")
    assert code == 0, shown
    compared = json.loads((tmp_path / "c.json").read_text())["models"]["model"]
    assert compared["verdict"] == judged["verdict"]  # by options as by the description


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_regions_and_reports_need_the_reference_and_name_the_option(case: Case, tmp_path: Path) -> None:
    identified(case, tmp_path)
    known = ("--description", tmp_path / "my_rig.yaml")
    for command, result in (("regions", "summary.json"), ("report", "report.html")):
        code, shown = amb(command, FOLDER / case.file, *known, "--out", tmp_path / command)
        if case.file in WITH_REFERENCE:
            assert code == 0, shown
            assert (tmp_path / command / result).exists()
        else:
            assert code == 1
            assert "--reference" in shown
            assert not (tmp_path / command / result).exists()


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_distortion_is_measured_or_refused_with_the_reason(case: Case, tmp_path: Path) -> None:
    identified(case, tmp_path)
    code, shown = amb(
        "distortion", FOLDER / case.file, "--description", tmp_path / "my_rig.yaml", "--out", tmp_path / "d"
    )
    assert code == 1  # none of these files holds whole periods of a multisine, or is long enough for coherence
    reason = "the reference repeats no period" if case.file in WITH_REFERENCE else "--reference"
    assert shown.count(reason) == 1
