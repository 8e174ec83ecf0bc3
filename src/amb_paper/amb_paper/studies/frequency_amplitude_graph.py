"""Fig. 8 and 9: responses to sweeps of several amplitudes, and the frequency-amplitude graph from many sweeps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import Comparison, MapSettings, RegionMap, analytic_lines, build_map, compare
from amb_core.report.figures.region_map import map_chart
from amb_core.report.figures.sweep_comparison import sweep_comparison_chart
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, Workplace, judged
from amb_paper.sweeps import one_after_another, sweep_bearing, sweep_settings

SHOWN = (10e-6, 20e-6, 35e-6, 60e-6)  # m, amplitudes whose responses are drawn
GRID = 400  # points on each axis of the map at which the region is evaluated
SLOPE_ERROR = 0.15  # by which the slope of a boundary may differ from -1 and count as amplitude times frequency


class FrequencyAmplitudeGraph(Study):
    """The region map of the paper's bearing, from as many sweeps as its boundaries need."""

    name = "fig8-9"
    heading = "Fig. 8 and 9: the frequency-amplitude graph"
    against = LINEAR_IRON
    parallel = False  # its sweeps run on the cluster

    def run(self) -> StudyResult:
        """As `run_at`, on this machine."""
        return self.run_at(Workplace())

    def run_at(self, workplace: Workplace) -> StudyResult:
        """Simulate a few sweeps to show, build the map, compare it with analytic lines."""
        responses = [sweep_bearing(amplitude).case(f"{1e6 * amplitude:g} µm") for amplitude in SHOWN]
        region_map = paper_map(workplace)
        lines = analytic_lines(PlantParameters(), ControllerParameters())
        series = sweep_comparison_chart(responses, title="Sweeps on y of rising amplitude")
        graph = map_chart(region_map, lines, "Frequency-amplitude graph of the two-axis bearing")
        amplitudes = f"{1e6 * region_map.amplitudes[0]:g} to {1e6 * region_map.amplitudes[-1]:g} µm"
        return self.result(
            [DrawnFigure.of("fig8", series), DrawnFigure.of("fig9", graph)],
            [judge_regions(region_map), judge_fall(region_map), judge_speed(region_map), judge_extent(region_map)],
            {
                "amplitudes": Setting(f"{amplitudes}, {len(region_map.sweeps)} sweeps"),
                **sweep_settings(),
                "control current limit": Setting(f"{ControllerParameters().current_limit:g} A"),
            },
            [
                lines_note(compare(region_map, lines)),
                "The limit of the control current is assumed and decides where the bearing falls under gravity: with "
                "10 A instead of 3 A region D begins at twice the frequency.",
            ],
        )


def paper_map(workplace: Workplace) -> RegionMap:
    """The map of the paper's bearing; sweeps simulated earlier are read from the disk."""
    return build_map(
        MapSettings(),
        PlantParameters(),
        ControllerParameters(),
        cache=workplace.cache,
        scheduler=workplace.scheduler,
        workers=workplace.workers,
        progress=lambda progress: workplace.report(f"sweep {progress.done} of {progress.total}"),
    )


def judge_regions(region_map: RegionMap) -> Claim:
    """Whether every sweep runs through all regions in order; in part if some do, or most from B to D without C."""
    counts = {region: sum(region in sweep.boundaries for sweep in region_map.sweeps) for region in list(Region)[1:]}
    total = len(region_map.sweeps)
    resonances = sum(
        sweep.boundaries[Region.D].resonance for sweep in region_map.sweeps if Region.D in sweep.boundaries
    )
    start = region_map.settings.frequency_start
    in_order = [
        one_after_another({region: place.frequency for region, place in sweep.boundaries.items()}, start)
        for sweep in region_map.sweeps
    ]
    shown = [sweep.boundaries.keys() for sweep, ordered in zip(region_map.sweeps, in_order, strict=True) if ordered]
    whole = sum(counts.keys() <= regions for regions in shown)
    without_c = sum({Region.B, Region.D} <= regions for regions in shown)
    lacks = [f"{total - count} show no {region.name}" for region, count in counts.items() if count < total]
    lacks += [f"{in_order.count(False)} show them in another order"] * (False in in_order)
    return Claim(
        id="regions-in-order",
        paper_figure="Fig. 8",
        statement="With rising frequency, a sweep of any amplitude leads from region A through B and C to D; sweeps of "
        "many amplitudes make a graph of the regions, whose boundaries an algorithm can find.",
        finding=f"Of {total} sweeps, {counts[Region.B]} show B, {counts[Region.C]} C and {counts[Region.D]} D, "
        f"{resonances} of these by ordinary resonance; {whole} lead through B and C to D in order. No boundary was set "
        "by hand.",
        verdict=judged([whole == total], [whole > 0, without_c > total / 2]),
        reason=""
        if whole == total
        else f"Of {total} sweeps, {', '.join(lacks)}. The rotor delevitates before it oscillates by itself, or what "
        "oscillates is its input, folded at the sample rate. The paper states neither the limit of the control "
        "current, which decides where the bearing falls, nor the data of its iron; its algorithm is not public.",
        figure="fig8",
    )


def judge_fall(region_map: RegionMap) -> Claim:
    """Whether boundaries lie lower at larger amplitudes."""
    falling, pairs, parts = 0, 0, []
    for region in (Region.B, Region.D):
        frequency = region_map.frequencies(region)
        frequency = frequency[np.isfinite(frequency)]
        falls = int(np.sum(np.diff(frequency) < 0.0))
        falling, pairs = falling + falls, pairs + max(len(frequency) - 1, 0)
        if len(frequency):
            parts.append(f"{region.name} from {frequency[0]:.0f} to {frequency[-1]:.0f} Hz")
    share = falling / pairs if pairs else 0.0
    return Claim(
        id="boundaries-fall",
        paper_figure="Fig. 9",
        statement="Whether the bearing behaves linearly depends on amplitude and frequency together: a larger "
        "amplitude lowers the frequency at which it ceases to.",
        finding=f"From the smallest to the largest amplitude that has it, {' and '.join(parts)}; lower from one sweep "
        f"to the next in {falling} of {pairs} steps.",
        verdict="agrees" if share > 0.9 else "agrees in part" if share > 0.6 else "does not agree",
        reason="" if share > 0.9 else "At many steps to a larger amplitude a boundary is not lower.",
        figure="fig9",
    )


def judge_speed(region_map: RegionMap) -> Claim:
    """Whether amplitude times frequency is constant along the boundaries; what makes it so is section 2.2."""
    slopes = {region: _slope(region_map, region) for region in (Region.B, Region.D)}
    close = [abs(slope + 1.0) <= SLOPE_ERROR for slope in slopes.values()]
    return Claim(
        id="speed-decides",
        paper_figure="Fig. 9, eq. (4)",
        statement="The rate of change decides, so amplitude and frequency of the input count equally.",
        finding="Frequency of the boundary goes with the amplitude to the power of "
        + " and ".join(f"{slope:.2f} for {region.name}" for region, slope in slopes.items())
        + "; -1 means that amplitude times frequency decides.",
        verdict=judged(close),
        reason="" if all(close) else "It does so for one boundary only." if any(close) else "Their product does not.",
        figure="fig9",
    )


def judge_extent(region_map: RegionMap) -> Claim:
    """Share of the map outside region A."""
    linear, logarithmic = (1.0 - _linear_share(region_map, spread) for spread in (np.linspace, np.geomspace))
    many = [share > 0.5 for share in (linear, logarithmic)]
    return Claim(
        id="large-nonlinear-part",
        paper_figure="Fig. 9",
        statement="A surprisingly large part of all inputs makes the bearing behave nonlinearly.",
        finding=f"{100 * linear:.0f} % of the area of the graph lies outside of region A with linear axes, "
        f"{100 * logarithmic:.0f} % with logarithmic ones.",
        verdict=judged(many),
        reason="" if all(many) else "It depends on how the axes are drawn.",
        figure="fig9",
    )


def lines_note(comparisons: Sequence[Comparison]) -> str:
    """Explanation of the analytic lines, and their distance from the boundaries."""
    ratios = "; ".join(
        f"{one.line} over {one.region.name}: {one.median:.2f} ({one.ratio.min():.2f} to {one.ratio.max():.2f})"
        for one in comparisons
    )
    return (
        "The lines are calculated, not fitted: the amplitudes at which the control current reaches the bias current "
        "(bias limit), or the bias current less the static load current (static-load limit), changes as fast as the "
        "amplifiers can follow (slew limit), or is clipped so much that the negative stiffness wins (gain-loss limit). "
        f"Frequency of the line over that of the simulated boundary, median and range over the sweeps: {ratios}."
    )


def _slope(region_map: RegionMap, region: Region) -> float:
    """Slope of a boundary's logarithm over that of the amplitude, without resonance onsets; NaN if too few."""
    places = [
        (sweep.amplitude, sweep.boundaries[region].frequency)
        for sweep in region_map.sweeps
        if region in sweep.boundaries and not sweep.boundaries[region].resonance
    ]
    if len(places) < 2:
        return math.nan
    amplitude, frequency = np.log(places).T
    return float(np.polyfit(amplitude, frequency, 1)[0])


def _linear_share(region_map: RegionMap, spread: Callable[[float, float, int], NDArray[np.float64]]) -> float:
    """Share of the map's area in region A, with points spaced by a NumPy function."""
    settings = region_map.settings
    amplitude = spread(region_map.amplitudes[0], region_map.amplitudes[-1], GRID)
    frequency = spread(settings.frequency_start, settings.frequency_end, GRID)
    return float(np.mean(region_map.region_at(frequency[:, None], amplitude[None, :]) == Region.A))
