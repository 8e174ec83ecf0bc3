"""A page of everything that reports and certificates hold, the same every time it is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from amb_core.identification.frequency_response import FrequencyResponse
from amb_core.loop.records import LoopRecord
from amb_core.report.figures import bode_chart, orbit_chart, response_chart
from amb_core.report.pages.certificate_trace import signatures
from amb_core.report.pages.document import Badge, FigureBlock, Listing, Prose, Report, Section, TableBlock, VerdictStrip
from amb_core.report.pages.writer import write_report

POLE = "-0.242376 ± 0.712525j"
LONG = "noise and distortion together 53 % on x, 29 % on y (distortion alone not measured)"
HASH = "3b1e3d88fea486c67546efbd1961e03a" * 2


def write_specimen(folder: Path) -> Path:
    """Write the page to a folder that exists."""
    time = np.arange(2000.0)[:, np.newaxis] * 1e-4
    position = 1e-6 * np.hstack([np.sin(300.0 * time), np.cos(300.0 * time) - 68.0])
    record = LoopRecord(0, 1e-4, np.zeros_like(position), position, np.zeros_like(position))
    frequency = np.geomspace(1.0, 5e3, 200)
    gain = 1e-4 / (1.0 + 1j * frequency[:, np.newaxis, np.newaxis] / 60.0) ** 2 * np.array([[1.0, 0.1], [0.1, 1.0]])
    response = FrequencyResponse(
        frequency, gain, "model", input_names=("i_x", "i_y"), output_names=("x", "y"), input_units=("A", "A"),
        output_units=("m", "m"),
    )  # fmt: skip
    poles = TableBlock(
        ("pole z", "standard deviation (worse of real and imaginary part)", "natural frequency", "damping ratio", ""),
        [(POLE, "5.7e-05", "2029.2 Hz", "0.223", Badge("unstable", "limited")), ("1.021563", "", "34.0 Hz", "1", "")],
        "Poles of the plant",
    )
    wide = TableBlock(
        ("data", "recorded", "samples", "positions", "currents", "reference", "excited band"),
        [("bag", "2026-11-25T17:08:22+00:00", "10000 at 10000 Hz", "x 1.732 um, y 1.242 um", "x 0.2 A", "none", "–")],
        "Data: largest deviations from the mean",
    )
    hashes = TableBlock(("input", "SHA-256"), [("model", HASH), ("a_name_without_any_place_to_break_it", HASH)], "Read")
    report = Report(
        "Magnetic bearing under multisine excitation",
        "1.2 s of an active magnetic bearing at 10000 Hz.",
        [FigureBlock(response_chart(record).page()), TableBlock(("", ""), [("machine", "Pump 3")], "The recording")],
        [
            Section("Motion", [FigureBlock(orbit_chart(record).page(), "Orbit during the excitation")]),
            Section("Identified model", [poles, FigureBlock(bode_chart([response]).page())]),
            Section("Inputs", [wide, hashes, Prose("A paragraph."), Listing(f"plain text {HASH}", "Plain text")]),
            Section("Signature", [signatures("A. Engineer")]),
        ],
        "A specimen.",
        VerdictStrip(
            Badge("not validated", "bad", "Identified model"), "The frequency response is 63.5 % off.",
            [("order", Badge("10", section="Identified model")), ("distortion", Badge(LONG))],
        ),
    )  # fmt: skip
    page = folder / "specimen.html"
    write_report(report, page)
    return page
