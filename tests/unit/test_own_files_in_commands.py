"""Files of others in every command that takes data: the same options, a saved description for the next file, and a
refusal in one line, with the option that helps, where a command needs more than the file has."""

from __future__ import annotations

import functools
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import AmbError
from amb_core.identification import StateSpaceModel
from tests.benchmarks.first_hour.files import CASES, FOLDER, Case

FILES = {case.file: case for case in CASES if not case.helps}
"""One case for each file that can be identified."""
METHOD = ("--method", "ssarx")  # any will do, and this one is fast
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


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Case], Path]:
    """Folder with the model of a file, `model.json`, and its saved description, `my_rig.yaml`."""

    @functools.cache
    def folder_of(case: Case) -> Path:
        folder = tmp_path_factory.mktemp("identified")
        words = (*case.options, *METHOD, "--order", 2 * case.axes, "--save-description", folder / "my_rig.yaml")
        code, shown = amb("identify", FOLDER / case.file, *words, "--out", folder / "model.json")
        assert code == 0, shown
        return folder

    return folder_of


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_a_saved_description_reads_the_next_file_without_a_question(
    identified: Callable[[Case], Path], case: Case, tmp_path: Path
) -> None:
    first = StateSpaceModel.load(identified(case) / "model.json")
    following = tmp_path / f"next_{Path(case.file).name}"
    (shutil.copytree if (FOLDER / case.file).is_dir() else shutil.copy)(FOLDER / case.file, following)
    known = ("--description", identified(case) / "my_rig.yaml", *METHOD, "--order", first.order)
    code, shown = amb("identify", following, *known, "--out", tmp_path / "again.json")
    assert code == 0, shown
    again = StateSpaceModel.load(tmp_path / "again.json")
    assert again.a.tobytes() == first.a.tobytes()
    assert (again.input_names, again.output_names) == (first.input_names, first.output_names)
    assert (again.input_units, again.output_units) == (first.input_units, first.output_units)


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_validate_and_compare_take_the_same_options(
    identified: Callable[[Case], Path], case: Case, tmp_path: Path
) -> None:
    model, data = identified(case) / "model.json", FOLDER / case.file
    known = ("--description", identified(case) / "my_rig.yaml")
    code, shown = amb("validate", model, data, *known, "--results", tmp_path / "v.json")
    assert code in (0, NOT_VALIDATED), shown
    judged = json.loads((tmp_path / "v.json").read_text())
    compared_code, shown = amb("compare", model, data, *case.options, "--results", tmp_path / "c.json")
    assert compared_code == code, shown
    compared = json.loads((tmp_path / "c.json").read_text())["models"]["model"]
    assert compared["verdict"] == judged["verdict"]  # by options as by the description


@pytest.mark.parametrize("case", FILES.values(), ids=lambda case: case.file)
def test_regions_and_reports_need_the_reference_and_name_the_option(
    identified: Callable[[Case], Path], case: Case, tmp_path: Path
) -> None:
    known = ("--description", identified(case) / "my_rig.yaml")
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
def test_distortion_is_measured_or_refused_with_the_reason(
    identified: Callable[[Case], Path], case: Case, tmp_path: Path
) -> None:
    known = ("--description", identified(case) / "my_rig.yaml")
    code, shown = amb("distortion", FOLDER / case.file, *known, "--out", tmp_path / "d")
    assert code == 1  # none of these files holds whole periods of a multisine, or is long enough for coherence
    reason = "the reference repeats no period" if case.file in WITH_REFERENCE else "--reference"
    assert shown.count(reason) == 1


def test_a_proposed_description_is_saved_on_request_and_then_used(tmp_path: Path) -> None:
    lines = (FOLDER / "mil.csv").read_text().splitlines()
    heading = next(index for index, line in enumerate(lines) if "i_x" in line)
    renamed = lines[heading].replace("i_x", "cur_x").replace("x (mil)", "pos_x (mil)").replace("x [mil]", "pos_x [mil]")
    (tmp_path / "lab.csv").write_text("\n".join([*lines[:heading], renamed, *lines[heading + 1 :]]) + "\n")
    words = ("identify", tmp_path / "lab.csv", "--order", 2, "--controller", "none")
    code, shown = amb(*words, "--save-description", tmp_path / "lab.yaml")
    assert code == 1
    assert "check it, then give --description" in shown
    code, shown = amb(*words, "--description", tmp_path / "lab.yaml", "--out", tmp_path / "model.json")
    assert code == 0, shown
    model = StateSpaceModel.load(tmp_path / "model.json")
    assert (model.input_names, model.output_names) == (("i_x",), ("x",))
