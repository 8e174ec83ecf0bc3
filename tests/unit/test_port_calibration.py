"""The examples of a port around its registers: converters to metres and amperes, amperes to a duty cycle."""

from __future__ import annotations

import ctypes
import math
import re
import subprocess
from pathlib import Path

import pytest

from amb_core.rig.link.reference import COMPILER, SOURCE

Number = ctypes.c_double


class Position(ctypes.Structure):
    """`struct position_calibration`."""

    _fields_ = (("points", ctypes.c_uint8), ("code", Number * 8), ("position", Number * 8))


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    made = tmp_path_factory.mktemp("calibration") / "calibration.so"
    source = SOURCE / "ports" / "calibration.c"
    subprocess.run([*COMPILER, "-shared", "-fPIC", "-o", made, source, "-lm"], check=True)
    library = ctypes.CDLL(str(made))
    library.calibrated_position.restype = library.calibrated_current.restype = Number
    library.calibrated_position.argtypes = [ctypes.POINTER(Position), Number]
    library.calibrated_current.argtypes = [Number] * 3
    library.calibrated_temperature.restype, library.calibrated_temperature.argtypes = Number, [Number] * 3
    library.turned_back.argtypes = [Number] * 2 + [ctypes.POINTER(Number)] * 2
    library.compare_value.argtypes = [Number, Number, ctypes.c_uint32, ctypes.c_int]
    library.compare_value.restype = ctypes.c_uint32
    return library


@pytest.fixture
def sensor() -> Position:
    """Gain, offset and a bend: 0.25 um a code below the middle, 0.5 um above it."""
    return Position(3, (Number * 8)(1000.0, 2000.0, 3000.0), (Number * 8)(-250e-6, 0.0, 500e-6))


@pytest.mark.parametrize(
    ("reading", "position"),
    [(1000, -250e-6), (1500, -125e-6), (2000, 0.0), (2500, 250e-6), (3000, 500e-6)],
)
def test_a_position_is_read_from_the_table(
    code: ctypes.CDLL, sensor: Position, reading: float, position: float
) -> None:
    assert code.calibrated_position(sensor, reading) == pytest.approx(position, abs=1e-15)


@pytest.mark.parametrize("reading", [999, 3001, 0, math.nan])
def test_a_reading_beyond_the_table_is_a_failed_sensor(code: ctypes.CDLL, sensor: Position, reading: float) -> None:
    assert math.isnan(code.calibrated_position(sensor, reading))


def test_sensors_that_are_turned_show_the_axes_of_the_magnets(code: ctypes.CDLL) -> None:
    angle, true = math.radians(15.0), (30e-6, -70e-6)
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y = Number(cosine * true[0] + sine * true[1]), Number(-sine * true[0] + cosine * true[1])
    code.turned_back(cosine, sine, x, y)
    assert (x.value, y.value) == pytest.approx(true, abs=1e-18)


def test_a_current_has_offset_and_gain(code: ctypes.CDLL) -> None:
    assert code.calibrated_current(2048.0, 0.005, 2548.0) == pytest.approx(2.5)


@pytest.mark.parametrize(("reading", "temperature"), [(1, 200.0 / 4095), (2048, 100.024), (4094, 199.951)])
def test_a_temperature_beyond_the_limit_of_the_target_can_be_read(
    code: ctypes.CDLL, reading: float, temperature: float
) -> None:
    assert code.calibrated_temperature(200.0, 4095.0, reading) == pytest.approx(temperature, abs=1e-3)


@pytest.mark.parametrize("reading", [0, 4095, math.nan])
def test_a_thermistor_that_is_open_or_shorted_has_no_temperature(code: ctypes.CDLL, reading: float) -> None:
    assert math.isnan(code.calibrated_temperature(200.0, 4095.0, reading))


@pytest.mark.parametrize(
    ("current", "enabled", "compare"),
    [(2.5, 1, 250), (10.0, 1, 1000), (12.0, 1, 1000), (-1.0, 1, 0), (math.nan, 1, 0), (math.inf, 1, 1000), (2.5, 0, 0)],
)
def test_a_coil_current_becomes_a_compare_value(code: ctypes.CDLL, current: float, enabled: int, compare: int) -> None:
    assert code.compare_value(current, 10.0, 1000, enabled) == compare


def test_the_example_has_every_function_of_a_port(tmp_path: Path) -> None:
    example = SOURCE / "ports" / "example_board.c"
    subprocess.run([*COMPILER, "-O2", "-c", example, "-o", tmp_path / "o"], check=True)
    named = subprocess.run(["nm", tmp_path / "o"], check=True, capture_output=True, text=True).stdout
    asked = set(re.findall(r"(board_\w+)\(", (SOURCE / "board.h").read_text()))
    assert set(re.findall(r" T (board_\w+)", named)) == asked


HARDWARE = """
#include "example_board.c"
static __typeof__(*hardware()) chip; /* whose generator has a number ready at every third look, and counts them */
__typeof__(chip) *hardware() {
    static int looks;
    chip.random_ready = ++looks % 3 == 0;
    chip.random += chip.random_ready;
    return &chip;
}
volatile uint8_t ring[RING];
volatile size_t ring_end;
bool usb_write(const uint8_t *bytes, size_t count) { return bytes && count; }
"""


def test_the_example_takes_every_random_number_once(tmp_path: Path) -> None:
    ports, made = SOURCE / "ports", tmp_path / "example.so"
    (tmp_path / "hardware.c").write_text(HARDWARE)
    options = ["-shared", "-fPIC", f"-I{ports}", "-Dregisters=(*hardware())", "-o", made]
    sources = [tmp_path / "hardware.c", ports / "stream.c", ports / "calibration.c"]
    subprocess.run([*COMPILER, *options, *sources, "-lm"], check=True)
    drawn = (ctypes.c_uint8 * 16)()
    ctypes.CDLL(str(made)).board_random(None, drawn, ctypes.c_size_t(16))
    assert list(drawn) == list(range(1, 17))
