"""`amb reproduce`: the paper's figures and claims on the simulator, as a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder
from amb_bringup.commands.terminal import Terminal

if TYPE_CHECKING:
    from amb_paper.campaign import CampaignProgress
    from amb_paper.study import StudyResult


def reproduce(
    only: Annotated[
        list[str] | None, typer.Option(help="Only this study, such as fig3, and no report; may be repeated.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for report, figures and claims.")] = Path("results/paper"),
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a running dask scheduler, tls://host:port; by default, this machine.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Number of processes, by default one for each core.")] = None,
) -> None:
    """Reproduce every figure and claim of the paper on the simulator; finished studies are not run again."""
    from amb_paper.campaign import run_campaign
    from amb_paper.output import write_figures, write_paper
    from amb_paper.studies import STUDIES, studies_named
    from amb_paper.study import Workplace

    console = Terminal()
    studies = studies_named(only) if only else STUDIES
    make_folder(out)
    done = 0
    with Stages(console) as stages:

        def show(progress: CampaignProgress) -> None:
            nonlocal done
            done = progress.done
            stages.update("studies", done, progress.total, progress.last or "starting")

        def report(doing: str) -> None:
            stages.update("studies", done, len(studies), doing)

        workplace = Workplace(folder=out, scheduler=scheduler, workers=workers, report=report)
        results = run_campaign(studies, workplace, progress=show)
    console.print(_claims(results))
    if only:
        write_figures(out, results)
        console.print(f"figures as .png and .html: {out}")
    else:
        write_paper(out, results)
        console.print(f"index.html, claims.json, figures as .png and .html: {out}")


def _claims(results: dict[str, StudyResult]) -> Table:

    table = Table("paper", "claim", "finding", "verdict", title="The paper's claims on the simulator")
    colours = {"agrees": "green", "agrees in part": "yellow", "does not agree": "red"}
    for result in results.values():
        for claim in result.claims:
            verdict = Text(claim.verdict, colours[claim.verdict])
            table.add_row(claim.paper_figure, claim.id, claim.finding, verdict)
    return table
