"""Studies run, are kept, and are not run again; a study that fails does not cost the others."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from amb_core.ground.errors import RegionError
from amb_core.ground.tasks.provenance import code_version
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel
from amb_core.report.figures.style import PLANT
from amb_core.report.pages import TableBlock
from amb_paper.campaign import run_campaign
from amb_paper.page import paper_report
from amb_paper.studies import OPENING, STUDIES, studies_named
from amb_paper.study import Claim, DrawnFigure, Setting, Study, StudyError, StudyResult, Workplace
from amb_paper.sweeps import sweep_settings


class Drawing(Study):
    """Draws a line in this process, and counts how often."""

    name = "drawing"
    heading = "A line"
    parallel = False
    runs: ClassVar[int] = 0

    def run(self) -> StudyResult:
        type(self).runs += 1
        curve = Curve(np.arange(3.0), np.arange(3.0), "line", PLANT)
        chart = Chart("A line", "It rises.", (Panel(Axis("x (m)"), Axis("y (m)"), (curve,)),))
        claim = Claim("rises", "Fig. 0", "It rises.", "from 0 to 2 m", "agrees", figure="line")
        return StudyResult(
            [DrawnFigure.of("line", chart)], [claim], {"steps": Setting("3", "stated: Fig. 0")}, ["A note."]
        )


class Failing(Study):
    name = "failing"
    heading = "Nothing"
    parallel = False

    def run(self) -> StudyResult:
        raise RegionError("the rotor fell")


def test_a_finished_study_is_read_from_the_disk_as_it_was(tmp_path: Path) -> None:
    Drawing.runs = 0
    first = run_campaign([Drawing()], Workplace(cache=tmp_path))
    progress = []
    again = run_campaign([Drawing()], Workplace(cache=tmp_path), progress=progress.append)
    assert Drawing.runs == 1
    assert again == first
    assert [(step.done, step.reused) for step in progress] == [(1, 1)]


def test_a_study_that_has_the_machine_for_itself_is_told_when_it_begins(tmp_path: Path) -> None:
    reports: list[str] = []
    run_campaign([Drawing()], Workplace(cache=tmp_path, report=reports.append))
    assert reports == ["drawing"]


def test_others_are_kept_when_a_study_fails(tmp_path: Path) -> None:
    Drawing.runs = 0
    with pytest.raises(StudyError, match="failing: the rotor fell"):
        run_campaign([Failing(), Drawing()], Workplace(cache=tmp_path))
    run_campaign([Drawing()], Workplace(cache=tmp_path))
    assert Drawing.runs == 1


class Leaving(Drawing):
    """Leaves a file besides its result."""

    name = "leaving"

    def run_at(self, workplace: Workplace) -> StudyResult:
        (workplace.folder / "left").touch()
        return self.run()

    def files_are_whole(self, folder: Path) -> bool:
        return (folder / "left").exists()


def test_a_study_whose_files_are_gone_runs_again(tmp_path: Path) -> None:
    Leaving.runs = 0
    workplace = Workplace(folder=tmp_path, cache=tmp_path / "cache")
    run_campaign([Leaving()], workplace)
    run_campaign([Leaving()], workplace)
    assert Leaving.runs == 1
    (tmp_path / "left").unlink()
    run_campaign([Leaving()], workplace)
    assert Leaving.runs == 2
    assert (tmp_path / "left").exists()


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_a_result_depends_on_the_library_and_on_all_modules_of_this_package(study: Study) -> None:
    assert study.describe()["library"] == code_version("amb_core")
    assert study.describe()["studies"] == code_version("amb_paper")
    assert study.describe()["graph"] == code_version("amb_bringup")


def test_the_report_opens_with_a_sweep_and_the_map_and_counts_verdicts() -> None:
    drawn = Drawing().run()
    report = paper_report([Drawing()], {"drawing": drawn}, ["line", "line"], "")
    assert [type(block).__name__ for block in report.opening] == [
        "Prose",
        "FigureBlock",
        "Prose",
        "FigureBlock",
        "TableBlock",
    ]
    assert report.opening[-1].caption == "1 claims; agrees: 1, agrees in part: 0, does not agree: 0"
    assert len(OPENING) == 2


def test_the_report_shows_where_every_setting_and_value_comes_from() -> None:
    report = paper_report([Drawing()], {"drawing": Drawing().run()}, ["line", "line"], "")
    tables = [block for section in report.sections for block in section.blocks if isinstance(block, TableBlock)]
    experiment, bearing = tables
    assert experiment.rows == [("steps", "3", "stated: Fig. 0")]
    sources = {row[0]: row[-1] for row in bearing.rows}
    assert sources["controller.current_limit"] == "assumed"
    assert sources["magnetic_circuit.air_gap"] == "stated: table 1"
    assert sources["iron.hysteresis"].startswith("against section 2.4")


STATED = {  # by study: where the paper states something of the figure or claim that the study is about
    "fig2": set(),  # section 2.1 gives no number, and not which bearing with 1 DOF it is
    "fig3": set(),
    "equations": {"section 2.2", "equation (1)"},
    "causes": {"footnote 5", "table 1"},
    "causes-slow-amplifier": {"footnote 5", "table 1"},
    "fig5": {"section 2.3", "table 1"},
    "fig6-7": {"section 2.3"},
    "fig8-9": set(),  # "numerous frequency sweeps (of various combinations of the amplitude and maximum frequency)"
    "fig11-12": set(),  # "at the specified amplitude"; the 50 um of section 4 are those of the identification
    "fig13": {"section 4", "section 3.2", "sections 3.3 and 3.4"},
    "fig15": {"section 4"},
    "multisine": {"section 4"},
    "arx": set(),
}


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_a_study_marks_as_stated_only_what_the_paper_states_of_its_figure(study: Study) -> None:
    tree = ast.parse(inspect.getsource(inspect.getmodule(type(study))))
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    marks = {text.removeprefix("stated: ") for text in texts if text.startswith("stated")}
    assert marks == STATED[study.name]


def test_the_sweep_of_fig_5_is_assumed_for_the_other_figures() -> None:
    assert {one.source for one in sweep_settings().values()} == {"assumed, as stated for Fig. 5", "assumed"}
    assert sweep_settings("stated: section 2.3")["frequency"].source == "stated: section 2.3"


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_a_study_says_what_its_bearings_have_against_the_paper(study: Study) -> None:
    differs = {
        "fig5": [],  # its iron has saturation and hysteresis
        "equations": [],  # equation (1) has a constant permeability
        "fig6-7": ["rotor", "iron"],  # measured on the rig
        "causes-slow-amplifier": ["supply", "iron"],
    }
    assert list(study.against) == differs.get(study.name, ["iron"])
    assert all(setting.source.startswith("against ") for setting in study.against.values())


def test_claims_on_a_bearing_against_the_paper_agree_in_part_at_most_and_our_own_as_they_are() -> None:
    class Differing(Drawing):
        against: ClassVar[Mapping[str, Setting]] = {"supply": Setting("a supply of 30 V", "against table 1")}

    drawn = Drawing().run()
    result = Differing().result(drawn.figures, drawn.claims, drawn.parameters, drawn.notes, ours=drawn.claims)
    assert [claim.verdict for claim in result.claims] == ["agrees in part", "agrees"]
    assert result.claims[0].reason == "This experiment has a supply of 30 V, against the paper."
    assert result.parameters == {**drawn.parameters, **Differing.against}
    assert Drawing().result(drawn.figures, drawn.claims, drawn.parameters, drawn.notes) == drawn


def test_results_are_plain_json() -> None:
    result = Drawing().run()
    assert Study.from_json(json.loads(json.dumps(Study.to_json(result)))) == result


def test_studies_have_names_of_their_own() -> None:
    assert len({study.name for study in STUDIES}) == len(STUDIES)
    assert len({study.heading for study in STUDIES}) == len(STUDIES)
    with pytest.raises(StudyError, match="no study 'fig99'; the studies are"):
        studies_named(["fig99"])
