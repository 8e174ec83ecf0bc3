"""What the target emulator shows on /diagnostics."""

from __future__ import annotations

from amb_core.loop.pace import pace_values
from amb_core.rig.emulation import EmulatorReport, LinkCount


def emulator_values(port: int, report: EmulatorReport) -> dict[str, object]:
    """Keys and values of a report. State and counts of the target are those that it has last sent to a host."""
    status = report.status
    values: dict[str, object] = {
        "UDP port": port,
        "steps": report.steps,
        "boots": report.boots,
        "amplifiers": "on" if report.enabled else "off",
        "state": status.state.name if status is not None else "unknown, not yet asked by a host",
        "trips": trips_text(report) or "none",
    }
    if report.trouble:
        values["last fault of the plant"] = report.trouble
    if status is not None:
        values |= {
            "control steps missed": status.missed,
            "frames damaged": status.bad,
            "frames forged": status.forged,
            "frames replayed": status.replayed,
            "frames not sent by the target": status.unsent,
        }
    values |= _link_values("to host", report.to_host) | _link_values("from host", report.from_host)
    values["frames not sent by the system"] = report.unsent
    values["telemetry samples not delivered"] = report.to_host.samples
    return values if report.pace is None else values | pace_values(report.pace, "blocks")


def trips_text(report: EmulatorReport) -> str:
    """The latched trips with axis, or coil, and step; empty without any."""
    if report.status is None:
        return ""
    return ", ".join(f"{trip.reason.name} (axis {trip.axis}, step {trip.step})" for trip in report.status.trips)


def _link_values(direction: str, count: LinkCount) -> dict[str, object]:
    return {
        f"frames {direction}": count.frames,
        f"frames {direction} lost, doubled, reordered, corrupted": (
            f"{count.lost}, {count.doubled}, {count.reordered}, {count.corrupted}"
        ),
    }
