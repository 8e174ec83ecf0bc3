"""Verdicts on the frequency-amplitude graph follow from the map: another map, another verdict."""

from __future__ import annotations

from dataclasses import replace

import pytest

from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap
from amb_paper.studies.frequency_amplitude_graph import (
    judge_extent,
    judge_fall,
    judge_regions,
    judge_speed,
)

AMPLITUDES = (5e-6, 10e-6, 20e-6, 40e-6, 80e-6)


def map_with(*regions: Region, product: float = 10e-3, power: float = -1.0, resonance: bool = False) -> RegionMap:
    """A map whose boundaries are at amplitude^power times a constant, one above the other."""
    sweeps = tuple(
        MapSweep(
            amplitude,
            {
                region: Boundary(
                    int(region) * product / AMPLITUDES[0] * (amplitude / AMPLITUDES[0]) ** power, resonance
                )
                for region in regions
            },
            (),
            5000.0,
            1000,
        )
        for amplitude in AMPLITUDES
    )
    return RegionMap(MapSettings(amplitude_low=AMPLITUDES[0], amplitude_high=AMPLITUDES[-1]), sweeps)


@pytest.mark.parametrize(
    ("regions", "verdict"),
    [
        ((Region.B, Region.C, Region.D), "agrees"),
        ((Region.B, Region.D), "agrees in part"),
        ((Region.D,), "does not agree"),
    ],
)
def test_regions_agree_where_all_sweeps_show_all_of_them(regions: tuple[Region, ...], verdict: str) -> None:
    claim = judge_regions(map_with(*regions, product=1e-3))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


def reordered(region_map: RegionMap, *order: Region, sweeps: int = len(AMPLITUDES)) -> RegionMap:
    """The map with the regions of some sweeps in another order, from the lowest frequency upwards."""
    changed = [
        replace(sweep, boundaries=dict(zip(order, sweep.boundaries.values(), strict=True)))
        for sweep in region_map.sweeps[:sweeps]
    ]
    return replace(region_map, sweeps=(*changed, *region_map.sweeps[sweeps:]))


@pytest.mark.parametrize("order", [(Region.D, Region.C, Region.B), (Region.C, Region.B, Region.D)])
def test_a_map_whose_regions_begin_in_another_order_does_not_agree(order: tuple[Region, ...]) -> None:
    claim = judge_regions(reordered(map_with(Region.B, Region.C, Region.D, product=1e-3), *order))
    assert claim.verdict == "does not agree"
    assert "5 show them in another order" in claim.reason


def test_one_sweep_in_another_order_agrees_in_part() -> None:
    everything = map_with(Region.B, Region.C, Region.D, product=1e-3)
    claim = judge_regions(reordered(everything, Region.B, Region.D, Region.C, sweeps=1))
    assert claim.verdict == "agrees in part"
    assert "4 lead through B and C to D in order" in claim.finding


@pytest.mark.parametrize("lacking", [(Region.C, Region.D), (Region.C,)])
def test_sweeps_that_lack_a_region_agree_in_part_and_are_counted(lacking: tuple[Region, ...]) -> None:
    everything = map_with(Region.B, Region.C, Region.D, product=1e-3)
    fewer = [
        replace(one, boundaries={region: place for region, place in one.boundaries.items() if region not in lacking})
        for one in everything.sweeps[:2]
    ]
    claim = judge_regions(replace(everything, sweeps=(*fewer, *everything.sweeps[2:])))
    assert claim.verdict == "agrees in part"
    assert claim.reason.startswith("Of 5 sweeps, 2 show no C")


def test_a_region_that_begins_with_the_sweep_is_not_in_order() -> None:
    start = MapSettings().frequency_start
    at_once = map_with(Region.B, Region.C, Region.D, product=start * AMPLITUDES[0], power=0.0)
    assert judge_regions(at_once).verdict == "does not agree"


@pytest.mark.parametrize(("power", "verdict"), [(-1.0, "agrees"), (1.0, "does not agree")])
def test_boundaries_must_fall_with_the_amplitude(power: float, verdict: str) -> None:
    claim = judge_fall(map_with(Region.B, Region.D, product=0.5e-3, power=power))
    assert claim.verdict == verdict
    assert ("8 of 8 steps" if power < 0 else "0 of 8 steps") in claim.finding


@pytest.mark.parametrize(("power", "verdict"), [(-1.0, "agrees"), (-2.0, "does not agree")])
def test_speed_decides_only_where_amplitude_times_frequency_is_constant(power: float, verdict: str) -> None:
    assert judge_speed(map_with(Region.B, Region.D, power=power)).verdict == verdict


def test_one_boundary_of_constant_product_agrees_in_part() -> None:
    both, steep = (map_with(Region.B, Region.D, power=power) for power in (-1.0, -2.0))
    sweeps = tuple(
        replace(one, boundaries={**one.boundaries, Region.D: other.boundaries[Region.D]})
        for one, other in zip(both.sweeps, steep.sweeps, strict=True)
    )
    assert judge_speed(replace(both, sweeps=sweeps)).verdict == "agrees in part"


def test_onsets_by_resonance_are_no_matter_of_speed() -> None:
    claim = judge_speed(map_with(Region.B, Region.D, resonance=True))
    assert claim.verdict == "does not agree"
    assert "nan" in claim.finding


@pytest.mark.parametrize(
    ("frequency", "verdict"), [(50.0, "agrees"), (1000.0, "agrees in part"), (3000.0, "does not agree")]
)
def test_the_nonlinear_part_is_measured_on_both_kinds_of_axes(frequency: float, verdict: str) -> None:
    level = map_with(Region.B, product=frequency * AMPLITUDES[0], power=0.0)
    assert judge_extent(level).verdict == verdict
