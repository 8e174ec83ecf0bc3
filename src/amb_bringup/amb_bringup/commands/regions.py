"""`amb regions`: the regions that a recorded run went through."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.own_data import DataOptions, data_options
from amb_bringup.commands.progress import working
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_core.data.analysis.recorded_distortion import evidence_or_reason
from amb_core.data.analysis.recorded_regions import RecordedRegions, classify_run
from amb_core.ground.errors import ParameterError
from amb_core.ground.results import plain
from amb_core.loop.telemetry import describe_gaps
from amb_core.regions import Onset, Region
from amb_core.regions.stretches import beats, shares, stretches
from amb_core.report.linear_claim import LinearClaim


@data_options
def regions(
    files: DataOptions,
    bag: Annotated[Path, typer.Argument(help="Bag, or a data file (.csv, .mat, .npz, .parquet ...) with reference.")],
    run: Annotated[int | None, typer.Option(help="Run of the bag; by default the last one.")] = None,
    axes: Annotated[
        str, typer.Option(help="Axes to draw, such as x,y or x_a,y_b; by default those that are excited.")
    ] = "",
    out: Annotated[Path, typer.Option(help="Folder for sweep.png, sweep.html and summary.json.")] = (
        Path("results/regions")
    ),
) -> None:
    """Show where regions B, C and D begin in the telemetry of a bag, and draw the response in its regions."""
    console = Terminal()
    make_folder(out)
    recording, _ = files.recording(console, bag)
    with working(console, "classifying"):
        classified = classify_run(recording, run)
    drawn = _drawn_axes(axes, classified.record.axes)
    with working(console, "measuring distortion"):
        evidence = evidence_or_reason(recording, classified.run)
    summary = {**_summary(classified, bag), "distortion": evidence.as_dict()}
    _print(console, classified, summary)
    console.print(evidence.brief)
    _write(out, classified, summary, drawn)
    console.print(f"sweep.png, sweep.html, summary.json: {out}")


def _summary(classified: RecordedRegions, bag: Path) -> dict[str, Any]:
    """The result as plain JSON values, times in s and frequencies in Hz."""
    record, classification = classified.record, classified.classification
    shares = _judged_shares(classified)
    return {
        "bag": str(bag),
        "run": classified.run,
        "first_step": record.first_step,
        "steps": record.steps,
        "sample_time": record.sample_time,
        "gaps": classified.gaps,
        "frozen": classified.frozen,
        "delevitated": None if shares[Region.D] is None else Region.D in classification.onsets,
        "region_at_end": _region_at_end(classified),
        "shares": {region.name: share for region, share in shares.items()},
        "not_judged": classification.judged.as_dict,
        "onsets": {
            part: {region.name: _onset(region, onset) for region, onset in onsets.items()}
            for part, onsets in (("rotor", classification.onsets), *classification.axis_onsets.items())
        },
        "sampling_beats": [
            [
                _frequency(classified, first),
                _frequency(classified, last),
                first * record.sample_time,
                last * record.sample_time,
            ]
            for first, last in beats(classification.states)
        ],
        "parameters": classified.parameters.model_dump(),
    }


def _claim(classified: RecordedRegions) -> LinearClaim:
    return LinearClaim.of(classified.classification, classified.frozen)


def _region_at_end(classified: RecordedRegions) -> str | None:
    """The letter of the last region; None where nothing was classified, or A may not be said."""
    parts = stretches(classified.classification.states)
    if not parts or (parts[-1].region is Region.A and not _claim(classified).holds()):
        return None
    return parts[-1].region.name


def _judged_shares(classified: RecordedRegions) -> dict[Region, float | None]:
    """The shares of the time; None for a region that was not judged and not found either, and for an A not said."""
    found, claim = classified.classification, _claim(classified)
    known = {*claim.looked_for, *found.onsets, *([Region.A] if claim.holds() else [])}
    share = shares(stretches(found.states))
    return {region: part if region in known else None for region, part in share.items()}


def _onset(region: Region, onset: Onset) -> dict[str, Any]:

    return {
        "step": onset.step,
        "time": onset.time,
        "input_frequency": plain(onset.input_frequency),
        "resonance": onset.resonance,
        "reason": _reason(region, onset),
    }


def _reason(region: Region, onset: Onset) -> str:

    reason = {
        Region.B: "the bias drifts",
        Region.C: "oscillation much slower than the input",
        Region.D: "the rotor reaches the backup bearing",
    }[region]
    return reason + (", at the resonance of the loop" if onset.resonance else "")


def _frequency(classified: RecordedRegions, step: int) -> float | None:
    """Input frequency at a step according to the bag; None if unknown."""
    if classified.frequency is None:
        return None
    return cast(
        "float | None",
        plain(classified.frequency[min(step - classified.record.first_step, classified.record.steps - 1)]),
    )


def _print(console: Console, classified: RecordedRegions, summary: dict[str, Any]) -> None:

    if classified.gaps:
        what = "missing" if classified.gaps == classified.missing else "missing or not finite"
        console.print(f"{describe_gaps(classified.gaps)} are {what}; the classification restarts after", style="yellow")
    console.print(_table(classified, summary))
    claim = _claim(classified)
    sensors = classified.frozen_problem or claim.still_problem
    for problem in filter(None, (sensors, classified.centre_problem)):
        console.print(problem, style="yellow", highlight=False)
    if classified.longer > 1.0:
        used, rate = classified.parameters, 1.0 / classified.record.sample_time
        console.print(
            f"at {rate:.5g} Hz the default times of the classification are {classified.longer:.3g} times as long: "
            f"a state every {used.update_interval:.3g} s, slow oscillations up to {used.slow_frequency:.3g} Hz"
        )
    for low, high, start, stop in summary["sampling_beats"]:
        at = "" if low is None or high is None else f", {low:.0f} to {high:.0f} Hz"
        console.print(f"the input beats with the sample rate from {start:.2f} to {stop:.2f} s{at}")
    parts = stretches(classified.classification.states)
    if not parts:
        console.print("too short for B and C: they were not evaluated", style="yellow")
        return
    named = {region: claim.name if region is Region.A else region.name for region in Region}
    shown = {region: part for region, part in shares(parts).items()
             if region is Region.A or summary["shares"][region.name] is not None}  # fmt: skip
    time = ", ".join(f"{named[region]} {100 * part:.1f} %" for region, part in shown.items())
    last = f"in region {summary['region_at_end']}" if summary["region_at_end"] else claim.name
    console.print(f"at the end {last}; share of the time: {time}")
    judged = claim.judged
    for what in judged.reservations:
        console.print(what, style="yellow", highlight=False)
    if not all(judged.contact.values()):
        console.print("give the clearance with --clearance, such as 250um, if positions count from the centre")


def _table(classified: RecordedRegions, summary: dict[str, Any]) -> Table:

    claim, long_enough = _claim(classified), bool(stretches(classified.classification.states))
    end = summary["first_step"] + summary["steps"]
    table = Table("", "region", "from (s)", "input (Hz)", "reason", title=f"Run {summary['run']}, {end} steps")
    for column in table.columns[2:4]:
        column.justify = "right"
    for part, onsets in summary["onsets"].items():
        for name, onset in onsets.items():
            frequency = onset["input_frequency"]
            at = "" if frequency is None else f"{frequency:.1f}"
            table.add_row(part, name, f"{onset['time']:.3f}", at, onset["reason"])
        if not onsets:
            axis = None if part == "rotor" else part
            found = (Region.A.name if claim.holds(axis) else "", "", "", claim.absent(axis))
            table.add_row(part, *(found if long_enough else ("", "", "", "not classified")))
    return table


def _drawn_axes(wanted: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """The axes of an option: names with commas between them, or `xy` for both axes of a single bearing."""
    names = ("x", "y") if wanted == "xy" else tuple(name.strip() for name in wanted.split(",") if name.strip())
    if any(name not in known for name in names):
        raise ParameterError(f"--axes {wanted} is not allowed; the axes of the run: {', '.join(known)}")
    return names


def _write(out: Path, classified: RecordedRegions, summary: dict[str, Any], axes: tuple[str, ...]) -> None:
    """Write figure and summary; over frequency if the input is one rising sweep, else over time."""
    from amb_core.report.figures import sweep_chart
    from amb_core.report.figures.sweep import rises

    response = (classified.record, classified.classification, classified.frequency)
    over = "frequency" if rises(classified.frequency) else "time"
    drawn: dict[str, Any] = {"over": over, "axes": axes, "title": f"Regions of run {classified.run}"}
    sweep_chart(*response, **drawn, frozen=classified.frozen).save(out, "sweep")
    write_json(out / "summary.json", summary)
