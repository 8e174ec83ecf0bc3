"""On the page of a certificate: what is certified, from which data, by which program and standards, and who signs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from amb_core.report.pages.document import Block, Prose, Section, TableBlock
from amb_core.robustness.trace import STANDARDS, DataTrace, Trace

NOT_GIVEN = "not given"
_LINE = "_" * 30


def header_table(trace: Trace) -> TableBlock:
    """Machine, its state, dates and version."""
    header, made = trace.header, trace.made
    program = f"version {made['version']}" + (f", commit {made['commit']}" if made["commit"] else "")
    recorded = sorted({one.recorded for one in trace.data.values() if one.recorded})
    rows = [
        ("machine", trace.machine or NOT_GIVEN),
        ("serial number", header.serial_number or NOT_GIVEN),
        ("running speed", header.speed or NOT_GIVEN),
        ("load", header.load or NOT_GIVEN),
        ("date of the data", ", ".join(recorded) or "not known"),
        ("date of the certificate", made["date"]),
        ("program", program),
    ]
    return TableBlock(("", ""), rows, "What is certified")


def trace_section(trace: Trace) -> Section:
    """Data, controller with all gains, model, program and standards."""
    header = ("data", "recorded", "samples", "positions", "currents", "reference", "excited band")
    rows = [_row(role, one) for role, one in trace.data.items()]
    blocks: list[Block] = [TableBlock(header, rows, "Data: largest deviations from the mean")] if rows else []
    program = [(name, value or "not known") for name, value in trace.made.items()]
    blocks += [
        TableBlock(("controller", "value"), list(_gains(trace.controller)), "Controller to certify, with all gains"),
        TableBlock(("model", "value"), [(name, f"{value}") for name, value in trace.model.items()], "Model"),
        TableBlock(("program", "value"), program, "Program"),
        TableBlock(
            ("standard", "edition", "used for", "clauses"),
            STANDARDS,
            "Standards; the numbers of the clauses and the limits are to be checked there before the page is signed",
        ),
    ]
    return Section("Traceability", blocks)


def signature_section(trace: Trace) -> Section:
    """Validity, and lines to sign on."""
    valid = (
        trace.header.validity or "for the machine, controller, speed and load named above, until one of them changes"
    )
    return Section("Signature", [Prose(f"Valid: {valid}."), signatures(trace.header.author)])


def signatures(author: str) -> TableBlock:
    """Lines for the author, who may be named already, and for who checks."""
    rows = [
        ("computed and stated by", author or _LINE, "date and signature", _LINE),
        ("checked by", _LINE, "date and signature", _LINE),
    ]
    return TableBlock(("", "", "", ""), rows, "Signatures")


def _row(role: str, one: DataTrace) -> tuple[str, ...]:
    band = f"{one.excited_band[0]:.4g} to {one.excited_band[1]:.4g} Hz" if one.excited_band else "no reference"
    return (
        f"{role} {one.name}", one.recorded or "not known", f"{one.samples} at {one.sample_rate:g} Hz",
        _sizes(one.amplitude, 1e6, "um"), _sizes(one.current, 1.0, "A"), _sizes(one.reference, 1e6, "um"), band,
    )  # fmt: skip


def _sizes(values: Mapping[str, float], factor: float, unit: str) -> str:
    return ", ".join(f"{name} {factor * value:.4g} {unit}" for name, value in values.items()) or "none"


def _gains(controller: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values, the matrices of a linear law row by row."""
    yield "name", str(controller["name"] or "that of the experiment")
    yield "kind", str(controller["kind"])
    yield "SHA-256", str(controller["sha256"])
    for name, value in controller["parameters"].items():
        yield name, f"{value}"
    law = controller.get("model", {})
    for name in ("a", "b", "c", "d", "k", "input_offset", "output_offset", "input_names", "output_names"):
        if name in law:
            yield name, f"{law[name]}"
