"""The studies of rig, tones, map and excitations run, and what they hold fits together."""

from __future__ import annotations

import re

import pytest

from amb_core.report.pages import ANSWERS
from amb_paper.studies.excitations_on_the_map import ExcitationsOnTheMap
from amb_paper.studies.frequency_amplitude_graph import FrequencyAmplitudeGraph
from amb_paper.studies.subharmonics import Subharmonics
from amb_paper.studies.sweep_rig import RigSweep
from amb_paper.study import Study, Workplace

LARGEST_PAGE = 300_000  # bytes


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Workplace:
    """One cache for all, so that the map is built once."""
    return Workplace(tmp_path_factory.mktemp("files"), tmp_path_factory.mktemp("cache"))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "study",
    [RigSweep(), Subharmonics(), FrequencyAmplitudeGraph(), ExcitationsOnTheMap()],
    ids=lambda study: study.name,
)
def test_a_study_has_figures_for_its_claims(study: Study, workplace: Workplace) -> None:
    result = study.run_at(workplace)
    figures = {figure.name for figure in result.figures}
    assert {claim.figure for claim in result.claims} <= figures
    assert all(claim.verdict in ANSWERS and claim.finding for claim in result.claims)
    assert all(len(figure.page) < LARGEST_PAGE for figure in result.figures)
    assert all(claim.reason for claim in result.claims if claim.verdict != "agrees")
    assert not study.against or all(claim.verdict != "agrees" for claim in result.claims)
    told = " ".join((*result.notes, *(claim.finding for claim in result.claims)))
    assert not re.search(r"\bnan\b", told), "a number that is none"
