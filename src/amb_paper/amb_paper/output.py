"""Writes the results of the studies: figures, claims.json and the report."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from amb_core.ground.version import __version__
from amb_core.report.figures.saving import page_from_json, write_page
from amb_core.report.pages import write_report
from amb_paper.page import paper_report
from amb_paper.studies import OPENING, STUDIES
from amb_paper.study import StudyError, StudyResult


def write_paper(folder: Path, results: Mapping[str, StudyResult]) -> None:
    """Write figures, claims.json and index.html from the results of all studies; AmbError if that fails."""
    write_figures(folder, results)
    claims = [{"study": name} | asdict(claim) for name, result in results.items() for claim in result.claims]
    try:
        (folder / "claims.json").write_text(json.dumps(claims, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as problem:
        raise StudyError(f"{folder}/claims.json: cannot be written: {problem.strerror}") from None
    made_from = (
        f"Every number comes from `amb reproduce`, run with amb_core {__version__}, NumPy "
        f"{version('numpy')} and CPython {sys.version.split()[0]}."
    )
    write_report(paper_report(STUDIES, results, OPENING, made_from), folder / "index.html")


def write_figures(folder: Path, results: Mapping[str, StudyResult]) -> None:
    """Write each figure as .png and as a page; AmbError if that fails."""
    for figure in (figure for result in results.values() for figure in result.figures):
        try:
            (folder / f"{figure.name}.png").write_bytes(figure.png)
        except OSError as problem:
            raise StudyError(f"figure {figure.name} in {folder}: cannot be written: {problem.strerror}") from None
        write_page(folder, figure.name, page_from_json(figure.page))
