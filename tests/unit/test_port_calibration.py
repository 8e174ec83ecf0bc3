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
