"""Region maps, excitations over them, spectra and surfaces: what is drawn is what the results say."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from amb_core.designs.excitation import AxisCheck, ExcitationCheck
from amb_core.designs.excitation.load import Load
from amb_core.loop.records import LoopRecord
from amb_core.regions import Region
from amb_core.regions.region_map import (
    AnalyticLine,
    Boundary,
    Confirmation,
    ConfirmationSettings,
    DwellBoundary,
    GridCell,
    MapSettings,
    MapSweep,
    RegionMap,
)
from amb_core.regions.subharmonics import SubharmonicSettings, SubharmonicSurface, SurfaceSettings, analyse
from amb_core.report.figures.drawing import Band, Curve, Heat, HoverGrid, Note, Points
from amb_core.report.figures.overlay import overlay_chart
from amb_core.report.figures.region_map import map_chart, map_grid_chart
from amb_core.report.figures.spectrum import spectrum_chart
from amb_core.report.figures.surface import surface_chart


def sweep(amplitude: float, resonance: bool = False, beats: tuple[tuple[float, float], ...] = (), **at: float):
    boundaries = {Region[name]: Boundary(frequency, resonance) for name, frequency in at.items()}
    return MapSweep(amplitude, boundaries, beats, 5e3, 200_000)


@pytest.fixture(scope="module")
def region_map() -> RegionMap:
    return RegionMap(
        MapSettings(amplitude_low=10e-6, amplitude_high=100e-6),
        (
            sweep(10e-6, B=1000.0, D=4000.0, beats=((1600.0, 1700.0),)),
            sweep(30e-6, B=500.0, C=800.0, D=1000.0),
            sweep(100e-6, resonance=True, D=40.0),
        ),
    )


def items(chart, kind: type) -> list:
    return [item for panel in chart.panels for item in panel.items if isinstance(item, kind)]


def test_the_areas_are_the_regions_of_the_map(region_map) -> None:
    bands = {band.label[0]: band for band in items(map_chart(region_map), Band)}
    assert set(bands) == set("ABCD")
    for letter, band in bands.items():
        tall = band.high > 1.001 * band.low
        middle = np.sqrt(band.low * band.high)[tall]
        assert np.all(region_map.region_at(middle, 1e-6 * band.x[tall]) == Region[letter])


def test_areas_leave_no_place_out_and_cover_none_twice(region_map) -> None:
    bands = items(map_chart(region_map), Band)
    assert np.all(bands[0].low == 10.0)
    assert np.all(bands[-1].high == 5000.0)
    for lower, upper in pairwise(bands):
        np.testing.assert_array_equal(lower.high, upper.low)


def test_the_alt_text_has_the_frequencies_of_each_boundary_in_either_direction() -> None:
    settings = MapSettings(amplitude_low=10e-6, amplitude_high=100e-6)
    rising = RegionMap(settings, (sweep(10e-6, B=500.0, C=800.0, D=900.0), sweep(100e-6, B=600.0, D=900.0)))
    assert "B drifting bias begins from 500 to 600 Hz, C slow oscillation begins at 800 Hz" in map_chart(rising).alt
    assert "D delevitated begins at 900 Hz." in map_chart(rising).alt


def test_onsets_are_points_and_those_by_resonance_hollow(region_map) -> None:
    points = {item.label: item for item in items(map_chart(region_map), Points)}
    assert points["D, simulated"].x == pytest.approx([10.0, 30.0])
    assert points["D, simulated"].y == pytest.approx([4000.0, 1000.0])
    assert points["D, by resonance"].x == pytest.approx([100.0])
    assert points["D, simulated"].filled and not points["D, by resonance"].filled
    assert points["D, by resonance"].hover == ("100 µm, 40 Hz: D delevitated begins (ordinary resonance)",)


def test_lines_and_beats_are_drawn(region_map) -> None:
    line = AnalyticLine("slew limit", np.array([100.0, 1000.0]), np.array([50e-6, 10e-6]))
    curves = {curve.label: curve for curve in items(map_chart(region_map, (line,)), Curve)}
    assert curves["slew limit"].x == pytest.approx([50.0, 10.0])
    assert curves["input beats with the sample rate"].y[:2] == pytest.approx([1600.0, 1700.0])


def test_every_place_of_the_page_tells_amplitude_frequency_and_region(region_map) -> None:
    (grid,) = items(map_chart(region_map), HoverGrid)
    layers = [trace for trace in map_chart(region_map).page().data if trace.type == "heatmap"]
    assert len(layers) == 4
    covered = sum(np.isfinite(np.asarray(layer.z, dtype=float)) for layer in layers)
    assert covered.shape == (len(grid.y), len(grid.x))
    assert np.all(covered == 1)
    assert layers[3].hovertemplate == "%{x:.4~g} µm, %{y:.4~g} Hz: D delevitated<extra></extra>"


def test_a_confirmed_map_shows_the_band_from_sweep_to_fixed_sine(region_map) -> None:
    dwells = (
        DwellBoundary(30e-6, Region.B, "below", 400.0, 404.0),
        DwellBoundary(30e-6, Region.D, "below", 5000.0, float("inf")),
    )
    confirmation = Confirmation(ConfirmationSettings(), dwells, (), True)
    chart = map_chart(replace(region_map, confirmation=confirmation))
    bands = {band.label: band for band in items(chart, Band)}
    drift = bands["B, sweep to fixed sine"]
    assert (drift.low[0], drift.high[0]) == (pytest.approx(402.0, rel=1e-3), pytest.approx(500.0))
    falls = bands["D, sweep to fixed sine"]
    assert (falls.low[0], falls.high[0]) == (pytest.approx(1000.0), pytest.approx(5000.0)), "no fall up to the end"
    points = {item.label: item for item in items(chart, Points)}
    assert points["B, fixed sine"].y == pytest.approx([402.0], rel=1e-3)
    assert chart.table is not None
    assert chart.table.rows[1][-3:] == ("402", "", "none")
    assert chart.title == "Region map by sweeps and by fixed sines"
    assert points["B, sweep"].y.tolist() == [1000.0, 500.0], "fixed sines are simulated too"
    assert {bands[f"{letter}, sweep to fixed sine"].hatch for letter in "BD"} == {"\\"}, "unlike the regions"


def test_a_band_ends_where_the_rotor_falls_in_the_sweep() -> None:
    """A region that only fixed sines show may begin in the sweep above the fall, of which the sweep shows nothing."""
    settings = MapSettings(amplitude_low=30e-6, amplitude_high=60e-6)
    fall = {region: Boundary(frequency, False) for region, frequency in ((Region.C, 500.0), (Region.D, 800.0))}
    sweeps = (
        MapSweep(30e-6, fall, (), 800.0, 1000),
        MapSweep(60e-6, {Region.D: Boundary(350.0, False)}, (), 350.0, 1000),
    )
    dwells = tuple(DwellBoundary(size, Region.C, "below", 280.0, 280.0) for size in (30e-6, 60e-6))
    chart = map_chart(RegionMap(settings, sweeps, confirmation=Confirmation(ConfirmationSettings(), dwells, (), True)))
    band = {item.label: item for item in items(chart, Band)}["C, sweep to fixed sine"]
    assert (band.low[-1], band.high[-1]) == (pytest.approx(280.0), pytest.approx(350.0))


def test_axes_are_logarithmic_with_plain_numbers(region_map) -> None:
    layout = map_chart(region_map).page().layout
    assert (layout.xaxis.type, layout.yaxis.type) == ("log", "log")
    assert layout.xaxis.range == pytest.approx((1.0, 2.0))
    assert "500" in layout.yaxis.ticktext


def test_a_map_of_one_sweep_is_drawn() -> None:
    chart = map_chart(RegionMap(MapSettings(), (sweep(20e-6),)))
    assert [band.label for band in items(chart, Band)] == ["A steady bias"]
    assert "all of it is region A" in chart.alt
    low, high = chart.panels[0].x.limits
    assert low < 20.0 < high


def test_a_grid_has_a_panel_for_each_design_and_says_where_there_is_no_map(region_map) -> None:
    cells = [
        GridCell({"rotor.gravity": gravity, "controller.derivative_gain": gain}, None, None, cell_map, "")
        for gravity in (0.0, 9.81)
        for gain, cell_map in ((30.0, region_map), (38.0, region_map), (60.0, None))
    ]
    chart = map_grid_chart(cells)
    assert (len(chart.panels), chart.columns, chart.rows) == (6, 3, 2)
    assert chart.panels[4].title == "gravity 9.81, derivative_gain 38"
    assert [note.text for panel in (chart.panels[2], chart.panels[5]) for note in panel.items] == ["no map"] * 2
    assert len(map_grid_chart(cells).figure().axes) == 6
    assert map_grid_chart(cells).page().layout.meta["columns"] == 3


def axis_check(axis: str) -> AxisCheck:
    return AxisCheck(
        axis, "lines", np.array([15.0, 45.0, 600.0]), np.array([60e-6, 20e-6, 40e-6]),
        share=np.array([0.7, 0.1, 0.2]), region=np.array([0, 0, 2]), covered=np.array([True, True, False]),
        shares={Region.A: 0.8, Region.B: 0.0, Region.C: 0.2, Region.D: 0.0},
        load=Load(dict.fromkeys((Region.B, Region.C, Region.D), 2.0), 2.0, 0.0, 0.0), predicted=Region.C,
        rms=1e-5, peak=1e-5, command_rms=1.0, command_peak=1.0, slew_rms=1.0, slew_peak=1.0, limited=0.0,
    )  # fmt: skip


def test_the_sines_of_an_excitation_lie_on_the_map(region_map) -> None:
    shares = {Region.A: 0.8, Region.B: 0.0, Region.C: 0.2, Region.D: 0.0}
    check = ExcitationCheck(
        "square", (axis_check("x"), axis_check("y")), shares, Region.C, True, 0.5, "region C", (), 3.0, 3.0, 2e4
    )
    chart = overlay_chart(check, region_map)
    assert [panel.title for panel in chart.panels] == ["x: power 80 % in A, 20 % in C", "y: power 80 % in A, 20 % in C"]
    inside, outside = (item for item in chart.panels[0].items if isinstance(item, Points))
    assert (inside.x.tolist(), inside.y.tolist()) == (pytest.approx([60.0, 20.0]), [15.0, 45.0])
    assert inside.filled and not outside.filled
    assert inside.hover[0] == "60 µm, 15 Hz: 70 % of the power, A steady bias"
    assert "Verdict: region C." in chart.alt
    assert len(overlay_chart(check, region_map).page().layout.annotations) == 2


@pytest.mark.parametrize(("kind", "name"), [("square", "Square"), ("white_noise", "White noise"), ("prbs", "PRBS")])
def test_the_title_names_the_excitation_as_the_field_does(region_map, kind: str, name: str) -> None:
    shares = {region: float(region == Region.A) for region in Region}
    check = ExcitationCheck(kind, (axis_check("x"),), shares, Region.A, True, 0.5, "region A", (), 3.0, 3.0, 2e4)
    assert overlay_chart(check, region_map).title == f"{name} on the region map"


@pytest.fixture(scope="module")
def spectrum():
    settings = SubharmonicSettings(agreeing_blocks=2, longest_run=2.0, rest=0.0, fade_in=0.0)
    time = np.arange(20_000) * 1e-4
    position = 1e-6 * (
        10.0 * np.sin(2e2 * 2.0 * np.pi * time)
        + 8.0 * np.sin(3e2 * 2.0 * np.pi * time)
        + 0.5 * np.sin(1e2 * 2.0 * np.pi * time)
    )
    signals = np.column_stack([np.zeros(20_000), position])
    return analyse(LoopRecord(0, 1e-4, np.zeros_like(signals), signals, np.zeros_like(signals)), settings, 0)


def test_tones_and_their_difference_are_named_in_the_spectrum(spectrum) -> None:
    chart = spectrum_chart({"as asked": spectrum})
    points = {item.label: item for item in items(chart, Points)}
    assert points["tone"].x == pytest.approx([200.0, 300.0])
    assert points["tone"].y == pytest.approx([10.0, 8.0], rel=1e-6)
    assert points["product of the loop"].x == pytest.approx([100.0])
    assert {note.text for note in items(chart, Note)} == {"f1", "f2", "f2 - f1"}
    assert "f2 - f1 at 100 Hz has 0.5 µm" in chart.alt
    assert spectrum_chart({"as asked": spectrum, "shifted": spectrum}).page().layout.yaxis2.type == "log"


def test_a_surface_shows_sizes_where_there_are_any() -> None:
    state = np.array([["steady", "unsettled"], ["steady", "delevitated"]])
    known = np.array([[1e-6, np.nan], [2e-6, np.nan]])
    fields = dict.fromkeys(("difference", "slow_amplitude", "slow_frequency", "slow_rms", "bias"), known)
    surface = SubharmonicSurface(
        settings=SubharmonicSettings(),
        surface=SurfaceSettings(),
        inducing_amplitude=np.array([5e-6, 10e-6]),
        inducing_frequency=np.array([1000.0, 3000.0]),
        slow_origin=np.full((2, 2), ""),
        state=state,
        **fields,
    )
    chart = surface_chart(surface)
    heat = items(chart, Heat)[0]
    np.testing.assert_allclose(heat.values, [[1.0, np.nan], [2.0, np.nan]])
    places = {item.label: (item.x.tolist(), item.y.tolist()) for item in items(chart, Points)}
    assert places == {
        "no steady state": ([3000.0], [pytest.approx(5.0)]),
        "delevitated": ([3000.0], [pytest.approx(10.0)]),
    }
    assert "50 % of the responses are steady" in chart.alt
    assert "product f2 - f1 is largest, 2 µm, at 10 µm and 1000 Hz" in chart.alt
    assert surface_chart(surface).page().layout.coloraxis.cmax == pytest.approx(np.log10(2.0))
