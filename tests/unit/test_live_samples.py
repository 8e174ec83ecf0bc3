"""Samples for a live display: what is drawn of many samples, and how much is kept."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest

from amb_bringup.view.samples import KEPT_COLUMNS, SampleDisplay, Seen
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord
from amb_core.recording.live import ColumnPyramid, OrbitPath, RunningSpectrum, planes_of
from amb_core.recording.live.spectrum import LOWEST_BIN

SAMPLE_TIME = 1e-4


def machine(directions: dict[str, tuple[float, float, float]]) -> Machine:
    axes = tuple(MachineAxis(name, "a", 0.0, 0.0, way, 2.5, 10.0) for name, way in directions.items())
    return Machine("m", "simulator", 1.0 / SAMPLE_TIME, axes, (MachineBearing("a", 250e-6),))


def block(first_step: int, position: np.ndarray) -> LoopRecord:
    return LoopRecord(first_step, SAMPLE_TIME, np.zeros_like(position), position, np.zeros_like(position))


def test_a_single_peak_is_seen_in_the_columns_of_every_level() -> None:
    pyramid = ColumnPyramid(1, (2, 10, 40), kept=100)
    samples = np.zeros((400, 1))
    samples[323] = 7.0
    for part in np.array_split(samples, 13):  # blocks of any length
        pyramid.add(part)
    for level, width in enumerate(pyramid.widths):
        columns = pyramid.since(level, 0)
        assert pyramid.end(level) == 400 // width
        assert columns.high[323 // width - columns.first] == 7.0
        assert columns.high.sum() == 7.0


def test_only_the_last_columns_are_kept_and_new_ones_are_asked_for_by_number() -> None:
    pyramid = ColumnPyramid(1, (1,), kept=50)
    pyramid.add(np.arange(120.0)[:, None])
    assert list(pyramid.since(0, 0).low[:, 0]) == list(range(70, 120))
    assert list(pyramid.since(0, 118).low[:, 0]) == [118.0, 119.0]
    assert len(pyramid.since(0, 500).low) == 0


def test_missing_samples_leave_a_gap_of_their_length() -> None:
    pyramid = ColumnPyramid(1, (2,), kept=50)
    pyramid.add(np.ones((4, 1)))
    pyramid.skip(6)
    pyramid.add(np.ones((4, 1)))
    assert np.isnan(pyramid.since(0, 0).high[:, 0]).tolist() == [False, False, True, True, True, False, False]
    pyramid.skip(10**15)  # of a message with any step number
    assert np.isnan(pyramid.since(0, 0).high).all()


@pytest.mark.parametrize("steps", [1, 5, 7, 38, 40, 390, 1999])
@pytest.mark.parametrize("before", [0, 3, 41, 399])
def test_a_gap_is_that_of_samples_that_are_missing_on_every_level(steps: int, before: int) -> None:
    skipped, added = (ColumnPyramid(2, (2, 10, 40), kept=50) for _ in range(2))
    samples = np.random.default_rng(1).normal(size=(before + 100, 2))
    for pyramid in (skipped, added):
        pyramid.add(samples[:before])
    skipped.skip(steps)
    added.add(np.full((steps, 2), np.nan))
    for pyramid in (skipped, added):
        pyramid.add(samples[before:])
    for level in range(3):
        assert skipped.end(level) == added.end(level)
        for side in ("low", "high"):
            np.testing.assert_array_equal(getattr(skipped.since(level, 0), side), getattr(added.since(level, 0), side))


def test_a_long_gap_takes_no_memory_of_its_samples() -> None:
    pyramid = ColumnPyramid(15, (20, 100, 400, 2_000, 12_000), kept=550)
    tracemalloc.start()
    pyramid.skip(10**8)
    largest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert largest < 1_000_000
    assert pyramid.end(4) == 550


def test_widths_that_do_not_divide_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="ascending multiples"):
        ColumnPyramid(1, (2, 5), kept=10)


def test_the_farthest_point_of_each_group_stays_in_the_orbit() -> None:
    path = OrbitPath(planes_of(machine({"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)})), stride=10, kept=20)
    position = np.zeros((100, 2))
    position[57] = (3e-6, -4e-6)
    path.add(position[:55])
    path.add(position[55:])
    first, points = path.since(0)
    assert (first, len(points)) == (0, 10)
    assert points[5, 0].tolist() == [3e-6, -4e-6]


def test_sensors_at_45_degrees_give_the_same_orbit() -> None:
    half = np.sqrt(0.5)
    (plane,) = planes_of(machine({"v": (half, half, 0.0), "w": (-half, half, 0.0)}))
    measured = np.array([[half, -half]])  # of the position x = 1, y = 0
    assert np.allclose(measured @ plane.weights, [[1.0, 0.0]])


def test_a_thrust_bearing_has_no_orbit() -> None:
    assert planes_of(machine({"z": (0.0, 0.0, 1.0)})) == ()


def test_a_sine_has_its_amplitude_in_the_spectrum_and_the_mean_has_none() -> None:
    spectrum = RunningSpectrum(1, SAMPLE_TIME)
    time = np.arange(10_000) * SAMPLE_TIME
    for part in np.array_split(5e-5 + 2e-6 * np.sin(2 * np.pi * 130.0 * time), 97):
        spectrum.add(part[:, None])
    assert spectrum.ready
    amplitude = spectrum.amplitude()[:, 0]
    peak = np.argmax(amplitude)
    assert amplitude[peak] == pytest.approx(2e-6, rel=0.15)
    assert spectrum.frequency[peak] == pytest.approx(130.0, abs=4.0)
    assert amplitude[spectrum.frequency < 20.0].max() < 1e-9


def test_fewer_samples_have_a_spectrum_of_the_frequencies_that_they_resolve() -> None:
    spectrum = RunningSpectrum(1, SAMPLE_TIME)
    time = np.arange(1000) * SAMPLE_TIME
    spectrum.add(np.full((500, 1), 1e-3))
    spectrum.clear()
    spectrum.add((5e-5 + 2e-6 * np.sin(2 * np.pi * 630.0 * time))[:, np.newaxis])
    amplitude = spectrum.amplitude()[:, 0]
    assert np.nanmax(amplitude) == pytest.approx(2e-6, rel=0.01)
    assert spectrum.frequency[np.nanargmax(amplitude)] == pytest.approx(630.0, rel=0.02)
    resolved = spectrum.frequency >= LOWEST_BIN / (1000 * SAMPLE_TIME)
    assert np.isnan(amplitude[~resolved]).all()
    assert np.isfinite(amplitude[resolved]).all()


def header(frame: bytes) -> tuple[int, ...]:
    return struct.unpack_from("<8I", frame)


def test_a_page_gets_each_column_once() -> None:
    display = SampleDisplay()
    seen = Seen(level=0)
    display.add(1, block(0, np.zeros((100, 2))), 0.0)
    assert header(display.frame(seen))[3:6] == (0, 50, 6)
    assert display.frame(seen) is None
    display.add(1, block(100, np.zeros((100, 2))), 0.0)
    assert header(display.frame(seen))[3:6] == (50, 50, 6)


def test_a_page_that_sleeps_gets_a_bounded_frame() -> None:
    display = SampleDisplay()
    seen = Seen(level=0)
    for first in range(0, 200_000, 1000):
        display.add(1, block(first, np.zeros((1000, 2))), 0.0)
    assert header(display.frame(seen))[4] == KEPT_COLUMNS


def test_a_new_run_starts_a_new_display_and_old_blocks_do_not() -> None:
    display = SampleDisplay()
    display.add(1, block(0, np.zeros((100, 2))), 0.0)
    epoch = display.epoch
    display.add(1, block(0, np.zeros((100, 2))), 0.0)  # twice
    display.add(1, block(150, np.zeros((100, 2))), 0.0)  # after a gap
    assert (display.epoch, display.step, display.lost) == (epoch, 250, 50)
    display.add(2, block(0, np.zeros((100, 2))), 0.0)
    assert (display.epoch, display.step, display.lost) == (epoch + 1, 100, 0)


def test_a_spectrum_of_before_is_taken_back_where_samples_are_lost() -> None:
    display = SampleDisplay()
    assert display.spectrum() is None
    display.add(1, block(0, np.zeros((10_000, 2))), 0.0)
    assert struct.unpack_from("<4I", display.spectrum())[2] == len(display.layout()["frequency"])
    display.add(1, block(10_100, np.zeros((100, 2))), 0.0)
    assert struct.unpack("<4I", display.spectrum()) == (2, display.epoch, 0, 2)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_samples_that_are_no_positions_do_not_disturb_what_follows(value: float) -> None:
    display = SampleDisplay()
    display.use(machine({"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}))
    display.add(1, block(0, np.full((100, 2), value)), 0.0)
    assert display.frame(Seen()) is not None or display.frame(Seen(level=0)) is not None
    display.add(1, block(100, np.ones((20_000, 2))), 0.0)
    assert np.isfinite(display._spectrum.amplitude()).all()
