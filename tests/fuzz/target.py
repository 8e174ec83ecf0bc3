"""Hostile datagrams against the C target under sanitizers: `python -m tests.fuzz.target --frames 10000000`.

Writes results/target_fuzz.json: frames sent, findings, forged commands tried and accepted. The attack itself is
target_attack.c, which ends at its first finding; the same seed finds it again.
"""

from __future__ import annotations

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from amb_core.rig.link.reference import SOURCE
from tests.front_door.results import results_file
from tests.target_rig import KEY, golden

QUICK = 20_000  # frames of the smallest size
SANITIZED = (
    "gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-g", "-O2",
    "-fsanitize=address,undefined", "-fno-sanitize-recover=all",
)  # fmt: skip


def build(folder: Path) -> Path:
    """Compile the attack with the sanitizers."""
    attack = folder / "target_attack"
    here = (SOURCE / file for file in ("hosted/hosted.c", "ports/stream.c"))
    sources = [Path(__file__).with_name("target_attack.c"), *SOURCE.glob("*.c"), *here]
    subprocess.run([*SANITIZED, f"-I{SOURCE}", "-o", attack, *sources, "-lm"], check=True)
    exchange = b"".join(struct.pack("<H", len(item.frame)) + item.frame for item in golden() if item.from_host)
    (folder / "exchange").write_bytes(KEY + exchange)
    return attack


def run(frames: int, seed: int, jobs: int = 1) -> dict[str, object]:
    """Send so many frames; the counts of all jobs together."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="target_fuzz") as folder:
        attack = build(Path(folder))
        arguments = [str(attack), str(Path(folder) / "exchange"), str(frames // jobs)]
        running = [
            subprocess.Popen([*arguments, str(seed + job)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            for job in range(jobs)
        ]
        ended = [(process, *process.communicate()) for process in running]
    findings = [f"exit {process.returncode}: {errors.strip()}" for process, _, errors in ended if process.returncode]
    counts = [json.loads(output) for process, output, _ in ended if not process.returncode]
    total = {
        name: sum(count[name] for count in counts) for name in ("frames", "signed", "forged", "accepted", "currents")
    }
    states = [sum(count["states"][state] for count in counts) for state in range(5)]
    return total | {"states": states, "findings": findings, "seed": seed, "seconds": time.monotonic() - began}


def main() -> int:
    """Run what the command line asks for; 1 if anything was found."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--frames", type=int, default=10_000_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--jobs", type=int, default=2, help="processes, with seeds of their own")
    options.add_argument("--quick", action="store_true", help=f"{QUICK} frames, into results/quick")
    chosen = options.parse_args()
    figures = run(QUICK if chosen.quick else chosen.frames, chosen.seed, chosen.jobs)
    results_file("target_fuzz.json", chosen.quick).write_text(json.dumps(figures, indent=1) + "\n")
    print(json.dumps(figures))
    return 1 if figures["findings"] else 0


if __name__ == "__main__":
    sys.exit(main())
