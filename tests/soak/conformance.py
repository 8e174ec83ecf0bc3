"""Planted faults in ports of the target: what `amb rig check` says about each of them.

Each port is the POSIX example with one place of its C code changed as a porter might get it wrong.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from amb_core.rig.link.conformance import Complaint, Exchange, check_target
from amb_core.rig.link.reference import SOURCE

PATIENCE = 1.0  # s; a loaded machine answers late


@dataclass(frozen=True)
class Planted:
    """A fault: the place in the C code, what stands there instead, and the check that must name it."""

    file: str
    right: str
    wrong: str
    check: str


FAULTS = {
    "magic": Planted("frame.c", "0x55424d41", "0x41424d55", "description"),
    "checksum of other polynomial": Planted("frame.c", "0x1db71064", "0x1db71065", "description"),
    "version": Planted("amb_target.h", "AMB_VERSION = 2", "AMB_VERSION = 1", "description"),
    "floats of the other byte order": Planted("frame.c", "return amb_put(p, both.bits, 8);",
        "for (int i = 7; i >= 0; i--) *p++ = (uint8_t)(both.bits >> 8 * i);\n    return p;", "description"),
    "tag without the nonce": Planted("sha256.c", "AMB_NONCE", "0", "description"),
    "tag of a part of the frame": Planted("command.c", "amb_close(t, t->io, p + AMB_TAG, AMB_REPLY, step);", "",
        "reply"),
    "challenge forgotten": Planted("command.c", "memmove(p, p + 8, AMB_CHALLENGE);", "memset(p, 0, AMB_CHALLENGE);",
        "description"),
    "hello of any length answered": Planted("command.c", "length >= AMB_HEADER + AMB_HELLO_LENGTH + AMB_CRC", "length",
        "challenge"),
    "hello of its own version only": Planted("command.c", "if (valid && type == AMB_HELLO",
        "if (valid && t->io[4] == AMB_VERSION && type == AMB_HELLO", "challenge"),
    "a new nonce at each hello": Planted("command.c", "    describe(t, from);",
        "    board_random(t->board, t->nonce, AMB_NONCE), t->session = amb_get32(t->nonce);\n"
        "        describe(t, from);",
        "description"),
    "tag not checked": Planted("command.c", "if (difference) return AMB_FORGED;", "(void)difference;",
        "hostile frames"),
    "last byte of the tag not checked": Planted("command.c", "for (size_t i = 0; i < AMB_TAG; i++) difference",
        "for (size_t i = 0; i < AMB_TAG - 1; i++) difference", "hostile frames"),
    "checksum not checked": Planted("frame.c",
        "return amb_get16(frame + 6) == length - AMB_HEADER - AMB_CRC &&\n           "
        "amb_crc32(0, frame, length - AMB_CRC) == amb_get32(frame + length - AMB_CRC);",
        "return amb_get16(frame + 6) == length - AMB_HEADER - AMB_CRC;", "hostile frames"),
    "session not checked": Planted("command.c", " || amb_get32(t->io + 8) != t->session) return AMB_BAD;",
        ") return AMB_BAD;", "hostile frames"),
    "old counters taken": Planted("command.c", "return number <= last || far ? AMB_REPLAYED : AMB_COUNTS;",
        "return current && number <= last ? AMB_REPLAYED : AMB_COUNTS;", "hostile frames"),
    "nothing counted": Planted("command.c", "t->count[judgement]++;", "", "hostile frames"),
    "lost replies not repeated": Planted("command.c", "if (judgement == AMB_REPLAYED && !memcmp",
        "if (false && !memcmp", "repetition"),
    "counters without gaps only": Planted("command.c", "return number <= last || far ? AMB_REPLAYED : AMB_COUNTS;",
        "return number <= last || (!current && last && number > last + 1) ? AMB_REPLAYED : AMB_COUNTS;", "repetition"),
    "repeated commands executed again": Planted("command.c", "type == AMB_CLOCK && !repeated", "type == AMB_CLOCK",
        "repetition"),
    "NaN taken": Planted("command.c", "return value >= low && value <= high;", "return !(value < low || value > high);",
        "refusals"),
    "limits can be raised": Planted("command.c", "value[i] > 0.0 && value[i] <= t->config->limits[i]", "value[i] > 0.0",
        "refusals"),
    "wrong lengths taken": Planted("command.c", ": length != lengths[type - AMB_HEARTBEAT])",
        ": length < lengths[type - AMB_HEARTBEAT])", "refusals"),
    "references not checked": Planted("command.c",
        "if (!amb_keeps_distance(t, value, landing ? whole : t->limits, false)) return AMB_BAD_VALUE;",
        "if (t->state == AMB_OFF) return AMB_DONE;", "refusals"),
    "unknown types without a reply": Planted("command.c",
        "if (type < AMB_HEARTBEAT || type > AMB_RECORD) return AMB_UNKNOWN;",
        "if (type < AMB_HEARTBEAT || type > AMB_RECORD) return AMB_SILENT;", "refusals"),
    "bitmap of the other bit order": Planted("excitation.c", "| 1 << index % 8)", "| 128 >> index % 8)", "uploads"),
    "checksum of uploads not compared": Planted("excitation.c",
        "if (t->upload.sum != t->upload.crc) return AMB_CHECKSUM;", "", "uploads"),
    "amplitude not checked": Planted("excitation.c", "} else if (beyond_limit(t)) return AMB_BEYOND_LIMIT;", "}",
        "uploads"),
    "rows without the currents": Planted("target.c", "p = put_values(p, t->current, axes, wide);", "", "telemetry"),
    "status word in the wrong place": Planted("target.c",
        "p = put_values(put_values(p, t->reference, axes, wide), t->sensors.position, axes, wide);",
        "p = put_values(put_values(p + 4, t->reference, axes, wide), t->sensors.position, axes, wide);",
        "telemetry"),
    "steps of the last sample": Planted("target.c", "amb_send(t, block, p, AMB_TELEMETRY, first, &t->peer);",
        "amb_send(t, block, p, AMB_TELEMETRY, first / t->per_frame, &t->peer);", "telemetry"),
    "no status": Planted("target.c", "if (!t->per_frame || (", "if (t->per_frame || (", "telemetry"),
    "currents of the host answered": Planted("command.c", "if (type != AMB_CURRENT) reply(t, false, from);",
        "reply(t, false, from);", "loop by the host"),
    "record goes on after the trip": Planted("recorder.c", "if (t->record.kept || !rows) return;",
        "if (!rows) return;", "record"),
    "record from the start of the ring": Planted("recorder.c", "at = t->record.next + rows - left;", "at = first;",
        "record"),
    "record of the wrong steps": Planted("recorder.c", "amb_put(p, t->record.end - left, 8)",
        "amb_put(p, t->record.end - t->record.rows, 8)", "record"),
    "clock in microseconds": Planted("posix/main.c", "* 1000000000u + (uint64_t)now.tv_nsec",
        "* 1000000u + (uint64_t)now.tv_nsec / 1000u",
        "timing"),
    "another sample rate": Planted("posix/main.c", "next.tv_nsec += 1000000000 / RATE;",
        "next.tv_nsec += 900000000 / RATE;",
        "timing"),
}  # fmt: skip
"""Faults by name."""


def conformance(most: int = len(FAULTS)) -> dict[str, Any]:
    """Figures of the ports; what was not named is printed."""
    chosen = list(FAULTS.items())[:: -(-len(FAULTS) // most)]
    if right := named(None):
        raise AssertionError(f"the port without a fault is accused: {right}")
    with ThreadPoolExecutor(2) as pool:
        names = list(pool.map(lambda item: named(item[1]), chosen))
    count = 0
    for (name, fault), complaints in zip(chosen, names, strict=True):
        if any(one.check == fault.check for one in complaints):
            count += 1
        else:
            print(f"conformance: {name}: {complaints}", flush=True)
    return {"conformance": {"faults": len(chosen), "named": count}}


def named(fault: Planted | None) -> list[Complaint]:
    """What the checks say about a port with a fault."""
    with tempfile.TemporaryDirectory(prefix="amb_port") as name:
        program = _built(Path(name), fault)
        process = subprocess.Popen([program, "0"], stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            target = Exchange("127.0.0.1", int(process.stdout.readline()), b"", PATIENCE)
            try:
                return check_target(target)
            finally:
                target.close()
        finally:
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def _built(folder: Path, fault: Planted | None) -> Path:
    source = folder / "target"
    shutil.copytree(SOURCE, source, ignore=shutil.ignore_patterns("build"))
    if fault is not None:
        file = source / fault.file
        text = file.read_text()
        assert text.count(fault.right) >= 1, f"{fault.file} has no {fault.right!r} any more"
        file.write_text(text.replace(fault.right, fault.wrong, 1))
    program = folder / "port"
    files = [*sorted(source.glob("*.c")), source / "posix" / "main.c"]
    subprocess.run(["gcc", "-std=c99", "-O1", "-w", "-o", program, *files, "-lm"], check=True)
    return program
