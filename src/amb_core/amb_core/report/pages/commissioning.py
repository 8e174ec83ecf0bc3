"""The protocol of a commissioning as a page."""

from __future__ import annotations

from collections.abc import Iterable

from amb_core.report.figures.chart import Chart
from amb_core.report.figures.style import sentence
from amb_core.report.pages.document import Block, FigureBlock, Prose, Report, Section, TableBlock
from amb_core.rig.commissioning import Check, Protocol, Step

_WORDS = {True: "passed", False: "failed", None: ""}


def protocol_report(protocol: Protocol, figures: Iterable[Chart]) -> Report:
    """A page with all steps, their numbers and limits.

    Parameters
    ----------
    protocol : Protocol
        What was done.
    figures : iterable of Chart
        Their titles become headings.
    """
    failed = protocol.failed
    skipped = [step.name for step in protocol.steps if step.result == "skipped"]
    lead = f"Failed: {', '.join(step.name for step in failed)}. " if failed else "No step failed. "
    lead += f"Skipped: {', '.join(skipped)}." if skipped else "No step was skipped."
    rows = [(step.name, step.title, step.result, step.reason) for step in protocol.steps]
    sections = [_section(step) for step in protocol.steps if step.began]
    drawn = [Section(chart.title, [FigureBlock(chart.page())]) for chart in figures]
    return Report(
        f"Commissioning of {protocol.about.get('machine', 'a rig')}",
        lead,
        [
            TableBlock(("step", "what is done", "result", "why"), rows, "Steps"),
            TableBlock(("of the session", "value"), list(protocol.about.items()), "The session"),
        ],
        sections + drawn,
        "Every number was measured in this session; limits are options of amb commission.",
    )


def _section(step: Step) -> Section:
    blocks: list[Block] = [Prose(f"{step.title}. Begun {step.began}, {step.seconds:.1f} s: {step.result}.")]
    if step.reason:
        blocks.append(Prose(f"{sentence(step.reason)}."))
    if step.checks:
        rows = [(check.what, check.shown, check.limit, _WORDS[check.passed], _advice(check)) for check in step.checks]
        blocks.append(TableBlock(("what", "value", "limit", "result", "what to do"), rows, f"Checks of {step.name}"))
    return Section(f"Step: {step.name}", blocks)


def _advice(check: Check) -> str:
    return check.advice if check.passed is False else ""
