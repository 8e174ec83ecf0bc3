"""The report on a recorded run: regions, distortion, response and orbit, the model identified from it, its quality."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Literal

import numpy as np

from amb_core.data.analysis.recorded_distortion import evidence_or_reason
from amb_core.data.analysis.recorded_regions import RecordedRegions, classify_run
from amb_core.ground.errors import AmbError
from amb_core.ground.progress import Progress, unseen
from amb_core.ground.units import UM
from amb_core.loop.machine import radial_bearings
from amb_core.loop.telemetry import describe_gaps
from amb_core.regions import Region
from amb_core.regions.distortion import Evidence
from amb_core.regions.stretches import shares, stretches
from amb_core.report.figures.coherence import coherence_chart
from amb_core.report.figures.distortion import distortion_chart
from amb_core.report.figures.loop import orbit_chart
from amb_core.report.figures.style import region_label, sentence
from amb_core.report.figures.sweep import onset_text, rises, sweep_chart
from amb_core.report.linear_claim import NONE_FOUND, LinearClaim
from amb_core.report.pages.document import (
    Badge,
    Block,
    FigureBlock,
    Prose,
    Report,
    Section,
    State,
    TableBlock,
    VerdictStrip,
)

REGIONS, DISTORTION, MODEL = "Regions", "Distortion", "Identified model"  # headings to which the verdict links
_UNSET = 1980  # a clock that was never set

if TYPE_CHECKING:
    from amb_core.loop.experiments import AppliedExcitation
    from amb_core.loop.known_controller import KnownController
    from amb_core.loop.records import LoopRecord
    from amb_core.recording import Recording
    from amb_core.report.pages.identified_model import IdentifiedModel


def recording_report(
    recording: Recording,
    run: int | None = None,
    order: int | Literal["auto"] = 10,
    progress: Progress = unseen,
    controller: KnownController | None = None,
    entries: str = "",
    certified: bool = False,
) -> Report:
    """The report on a run of a bag.

    The model is identified from the last experiment of the run. If that cannot be done, for want of excitation for
    example, the lead and its section say so, and the other sections remain.

    Parameters
    ----------
    recording : Recording
        With telemetry.
    run : int, optional
        The run; by default the last one.
    order : int or "auto"
        Order of the model.
    progress : callable, optional
        Called with what is being done, see `amb_core.ground.progress.Progress`.
    controller : KnownController, optional
        The controller; by default the recorded one. Without either there is no model.
    entries : str, optional
        Entries of the Bode diagram, see `entries_from`; by default all.
    certified : bool
        Whether to add the robustness of the model with its controller, which takes some seconds; more for many axes.

    Raises
    ------
    BagError, RegionError
        As for `classify_run`.
    IdentificationError
        If no method takes the order.
    """
    from amb_core.identification.estimate.scaled_data import check_order  # takes a while to import

    if order != "auto":
        check_order(order)
    progress("classifying", 0, None)
    regions = classify_run(recording, run)
    progress("measuring distortion", 0, None)
    evidence = evidence_or_reason(recording, regions.run)
    sections = [_regions(regions), _distortion(evidence)]
    progress("drawing", 0, None)
    sections.append(_motion(regions.record, _excited(recording, regions)))
    identified, problem = _identified(recording, regions.run, order, controller, progress, entries, certified)
    sections += [Section(MODEL, [Prose(f"There is none: {problem}.")])] if identified is None else identified.sections
    return Report(
        _title(recording, regions),
        _lead(regions, evidence) + (f" No model: {problem}." if problem else ""),
        [FigureBlock(_sweep(regions)), _experiment(recording, regions)],
        sections,
        f"Every number comes from the bag {recording.path}.",
        _strip(regions, evidence, identified),
    )


def _title(recording: Recording, regions: RecordedRegions) -> str:
    """What was done, and when, as far as the bag says."""
    kinds = list(dict.fromkeys(item.kind for item in _excitations(recording, regions.run)))
    if kinds:
        text = f"Magnetic bearing under {' and '.join(kinds)} excitation"
    else:
        text = f"Magnetic bearing {'with a moving reference' if _reference_moves(regions) else 'without excitation'}"
    when = datetime.fromtimestamp(recording.start / 1e9, UTC)
    return f"{text}, {when:%Y-%m-%d %H:%M} UTC" if when.year > _UNSET else text


def _reference_moves(regions: RecordedRegions) -> bool:
    """Whether there is an excitation, though of a kind that the recording does not name, as that of a file."""
    reference = regions.record.reference
    return bool(np.any(np.nanmax(reference, axis=0) > np.nanmin(reference, axis=0)))


def _excitations(recording: Recording, run: int) -> list[AppliedExcitation]:
    return [item for item in recording.excitations(run) if item.accepted and item.steps]


def _claim(regions: RecordedRegions) -> LinearClaim:
    return LinearClaim.of(regions.classification, regions.frozen)


def _sensor_problem(regions: RecordedRegions) -> str:
    """What positions that stand still mean, with their steps where those are known; empty without any."""
    return regions.frozen_problem or _claim(regions).still_problem


def _strip(regions: RecordedRegions, evidence: Evidence, identified: IdentifiedModel | None) -> VerdictStrip:
    """The verdict on the model, its main numbers, and region and distortion of the recording."""
    onsets = regions.classification.onsets
    worst, claim = max(onsets, default=Region.A), _claim(regions)
    classified = stretches(regions.classification.states)
    states: dict[Region, State] = {Region.A: "good", Region.B: "limited", Region.C: "limited", Region.D: "bad"}
    region = (
        Badge(region_label(worst), states[worst], REGIONS) if classified else Badge("not classified", section=REGIONS)
    )
    if classified and not onsets and not claim.holds():
        region = Badge(f"{claim.judged.absent()} found", section=REGIONS)
    if claim.still:
        region = Badge("sensor dead or stuck", "bad", REGIONS)
    seen = [
        ("worst region", region),
        ("distortion", Badge(evidence.brief.removeprefix("distortion "), section=DISTORTION)),
    ]
    if identified is None:
        return VerdictStrip(Badge("no model", "bad", MODEL), "None could be identified, see below.", seen)
    return VerdictStrip(identified.verdict, identified.reason, [*identified.badges, *seen])


def _lead(regions: RecordedRegions, evidence: Evidence) -> str:
    record, classification = regions.record, regions.classification
    seconds = record.steps * record.sample_time
    text = (
        f"{seconds:.{1 if seconds >= 1.0 else 4}f} s of an active magnetic bearing at {1.0 / record.sample_time:g} Hz. "
    )
    if problem := _sensor_problem(regions):
        text += f"{sentence(problem)}. "
    claim = _claim(regions)
    said = (*claim.judged.reservations, *filter(None, [regions.centre_problem]))
    reservations = "".join(f" {sentence(what)}{'' if what.endswith('?') else '.'}" for what in said)
    if not classification.onsets and not claim.still:
        found = "Region A all the time" if claim.holds() else f"{sentence(claim.absent())} found"
        found = found if stretches(classification.states) else "Too short for regions B and C"
        return text + f"{found}; {evidence.brief}.{reservations}"
    if not classification.onsets:
        return text + f"{sentence(evidence.brief)}.{reservations}"
    begins = [f"{region_label(region)}, from {onset_text(onset)}" for region, onset in classification.onsets.items()]
    left = "It left region A for " if claim.holds() else "Found: "
    return text + left + "; ".join(begins) + f". Over the whole, {evidence.brief}.{reservations}"


def _sweep(regions: RecordedRegions):  # type: ignore[no-untyped-def]  # plotly has no types
    over: Literal["time", "frequency"] = "frequency" if rises(regions.frequency) else "time"
    return sweep_chart(
        regions.record, regions.classification, regions.frequency, over=over, title="Regions of the run",
        frozen=regions.frozen,
    ).page()  # fmt: skip


def _experiment(recording: Recording, regions: RecordedRegions) -> TableBlock:
    record = regions.record
    excitations = [
        f"{item.kind}, steps {item.first_step} to {item.stop - 1}" for item in _excitations(recording, regions.run)
    ]
    controller = recording.controller_parameters(regions.run)
    missing = sum(stop - start for start, stop in regions.missing)
    rows = [
        ("run", str(regions.run)),
        ("steps", f"{record.steps}, from step {record.first_step} on"),
        ("samples", str(record.steps - missing)),
        ("sample time", f"{1e6 * record.sample_time:g} µs"),
        ("excitations", "; ".join(excitations) or ("the reference moves" if _reference_moves(regions) else "none")),
        ("missing", describe_gaps(regions.gaps) if regions.gaps else "nothing"),
    ]
    if controller is not None:
        gains = f"{controller.proportional_gain:g} A/m, {controller.derivative_gain:g} A s/m"
        rows.append(("controller gains", gains))
    return TableBlock(("of the recording", "value"), rows, "The recording")


def _regions(regions: RecordedRegions) -> Section:
    classification = regions.classification
    share = shares(stretches(classification.states))
    rows = [
        (
            part,
            region_label(region),
            f"{onset.time:.3f} s",
            "" if np.isnan(onset.input_frequency) else f"{onset.input_frequency:.1f} Hz",
        )
        for part, onsets in (("rotor", classification.onsets), *classification.axis_onsets.items())
        for region, onset in onsets.items()
    ]
    claim = _claim(regions)
    labels = {region: region_label(region) for region in Region}
    if not claim.holds():
        labels[Region.A] = NONE_FOUND
    time = ", ".join(f"{labels[region]}: {100.0 * part:.1f} %" for region, part in share.items() if part > 0.0)
    blocks: list[Block] = [
        Prose(f"Share of the time in each region: {time}." if time else "Too short for regions B and C.")
    ]
    blocks += [Prose(f"{sentence(what)}.") for what in claim.judged.reservations]
    if problem := _sensor_problem(regions):
        blocks.insert(0, Prose(f"{sentence(problem)}."))
    if rows:
        blocks.append(TableBlock(("part", "region", "begins at", "input frequency"), rows, "Where regions begin"))
    return Section(REGIONS, blocks)


def _distortion(evidence: Evidence) -> Section:
    blocks: list[Block] = [
        Prose(
            "Region A means that the bias neither drifts nor oscillates slowly. How much of the motion no linear model "
            "can follow is another question."
        )
    ]
    blocks += [Prose(f"{sentence(text)}.") for text in evidence.lines]
    if evidence.distortion is not None:
        blocks.append(FigureBlock(distortion_chart(evidence.distortion).page(), "Lines of the position"))
    if evidence.coherence is not None:
        blocks.append(FigureBlock(coherence_chart(evidence.coherence).page(), "Coherence of position and reference"))
    return Section(DISTORTION, blocks)


def _excited(recording: Recording, regions: RecordedRegions) -> LoopRecord:
    """The part of the run from its first excitation to its last: lift-off and landing would squash an orbit."""
    excitations, record = _excitations(recording, regions.run), regions.record
    if not excitations:
        return record
    end = record.first_step + record.steps
    first = max(min(item.first_step for item in excitations), record.first_step)
    stop = min(max(item.stop for item in excitations), end)
    return record.window(first, stop - first) if stop > first else record


def _motion(record: LoopRecord, excited: LoopRecord) -> Section:
    reach = UM * np.nanmax(np.abs(record.position), axis=0)
    mean = UM * np.nanmean(record.position, axis=0)
    blocks: list[Block] = [
        TableBlock(
            ("axis", "mean", "farthest from the centre"),
            [(name, f"{mean[axis]:z.1f} µm", f"{reach[axis]:.1f} µm") for axis, name in enumerate(record.axes)],
            "Rotor position",
        )
    ]
    if radial_bearings(record):
        title = "Orbit" if excited is record else "Orbit during the excitation"
        blocks.append(FigureBlock(orbit_chart(excited).page(), title))
    return Section("Motion", blocks)


def _identified(
    recording: Recording,
    run: int,
    order: int | Literal["auto"],
    controller: KnownController | None,
    progress: Progress,
    entries: str,
    certified: bool,
) -> tuple[IdentifiedModel | None, str]:
    """The model of the run, or the reason why there is none."""
    from amb_core.report.pages.identified_model import identified_model

    try:
        controller = controller or recording.controller(run)
        return identified_model(recording, run, order, controller, progress, entries, certified), ""
    except AmbError as problem:
        return None, str(problem)
