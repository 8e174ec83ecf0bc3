"""The report on the paper: one sweep, the map, then figure by figure the paper's statements and our results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from amb_core.ground.parameters import shown_value
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.description import values_with_sources
from amb_core.report.figures.saving import page_from_json
from amb_core.report.pages import (
    ANSWERS,
    Answer,
    Badge,
    Block,
    FigureBlock,
    Prose,
    Report,
    Section,
    State,
    TableBlock,
    Verdict,
)
from amb_paper.study import DrawnFigure, Study, StudyResult

_STATES: dict[Answer, State] = {"agrees": "good", "agrees in part": "limited", "does not agree": "bad"}


def paper_report(
    studies: Sequence[Study], results: Mapping[str, StudyResult], opening: Sequence[str], made_from: str
) -> Report:
    """The report on the results of studies.

    Parameters
    ----------
    studies, results
        The studies, and their results by name.
    opening : sequence of str
        Names of the first figures.
    made_from : str
        Source of the numbers.
    """
    figures = {figure.name: figure for result in results.values() for figure in result.figures}
    claims = [claim for study in studies for claim in results[study.name].claims]
    counts = ", ".join(f"{answer}: {sum(claim.verdict == answer for claim in claims)}" for answer in ANSWERS)
    rows = [
        (
            claim.statement,
            claim.finding,
            claim.paper_figure,
            Badge(claim.verdict, _STATES[claim.verdict], study.heading),
        )
        for study in studies
        for claim in results[study.name].claims
    ]
    table = TableBlock(
        ("the paper states", "found here", "place", "verdict"),
        rows,
        f"{len(claims)} claims; {counts}",
        filters=("place", "verdict"),
    )
    return Report(
        "What magnetic bearings do when they are shaken too fast",
        "Shaken slowly, an active magnetic bearing follows about a steady position. Shaken faster, at the same "
        "amplitude, its rotor drifts away from the centre, may oscillate slowly, and then falls. This page reproduces, "
        "on a simulated bearing and figure by figure, the paper “LTI modelling of active magnetic bearings by means of "
        "system identification”.",
        [*_opening([figures[name] for name in opening]), table],
        [*(Section(study.heading, _blocks(results[study.name])) for study in studies), values_section()],
        made_from,
    )


def values_section() -> Section:
    """The values of the bearing, each stated by the paper, assumed, or against it."""
    values = values_with_sources(PlantParameters(), ControllerParameters())
    rows = [(one.name, shown_value(one.value), "" if one.unit == "-" else one.unit, one.source) for one in values]
    return Section(
        "The values: stated, assumed, or against the paper",
        [
            Prose(
                "The bearing of all studies, except for what a study gives as its own. Values that the paper states "
                "come with the place. Its iron has no saturation and no hysteresis, against the simulation of section "
                "2.4, since the paper does not state their data: claims on it agree in part at most. All other values "
                "are assumed, above all the limit of the control current, which decides where the bearing falls."
            ),
            TableBlock(("parameter", "value", "unit", "source"), rows, "The bearing", filters=("source",)),
        ],
    )


def _opening(figures: Sequence[DrawnFigure]) -> list[Block]:
    """Figures with their titles as text above, since there is no section heading yet."""
    return [
        block for figure in figures for block in (Prose(f"{figure.title}."), FigureBlock(page_from_json(figure.page)))
    ]


def _blocks(result: StudyResult) -> list[Block]:
    blocks: list[Block] = [Prose(note) for note in result.notes]
    blocks += [FigureBlock(page_from_json(figure.page), figure.title) for figure in result.figures]
    if result.parameters:
        rows = [(name, setting.value, setting.source) for name, setting in result.parameters.items()]
        blocks.append(TableBlock(("setting", "value", "source"), rows, "The experiment"))
    return blocks + [Verdict(claim.statement, claim.finding, claim.verdict, claim.reason) for claim in result.claims]
