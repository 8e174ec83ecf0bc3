"""Writes requirements.hashes, and one such file of each extra: the pins with the hashes of the files that pip installs.

Run it after a change of a requirements*.txt; it asks the index for the files of each Python that the workspace runs on,
and of the oldest and the newest C library.
`scripts/setup.sh` installs nothing whose hash is another.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12")
OLDEST = ("manylinux_2_28_x86_64", "manylinux2014_x86_64")
"""Platforms of the oldest C library for which there are wheels of ROS, 2.28; pip may take other files there."""
SOURCES = ("empy==",)
"""Pins without a wheel."""
HEADER = "# Made by scripts/hash_requirements.py from {}, which is the file to change.\n"


def normal(name: str) -> str:
    """A name as the index spells it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def hashes(requirements: Path, python: str, *options: str) -> dict[str, str]:
    """SHA-256 of the file of each package for a version of Python and options of pip, by normal name."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        command = [sys.executable, "-m", "pip", "install", "-qq", "--dry-run", "--ignore-installed", "--no-deps"]
        command += ["--python-version", python, "--target", folder, "--report", str(report), *options]
        subprocess.run([*command, "-r", str(requirements)], check=True)
        items = json.loads(report.read_text())["install"]
    return {
        normal(item["metadata"]["name"]): item["download_info"]["archive_info"]["hashes"]["sha256"] for item in items
    }


def write(requirements: Path) -> None:
    """Write the file with the hashes of a file of pins."""
    digests_of: defaultdict[str, set[str]] = defaultdict(set)
    oldest = ["--only-binary", ":all:", *(f"--platform={platform}" for platform in OLDEST)]
    with tempfile.TemporaryDirectory() as folder:
        wheels = Path(folder, "wheels.txt")
        wheels.write_text("".join(line for line in requirements.open() if not line.startswith(SOURCES)))
        for python in PYTHONS:
            found = [hashes(requirements, python), hashes(wheels, python, *oldest)]
            for name, digest in (item for one in found for item in one.items()):
                digests_of[name].add(digest)
    lines = [HEADER.format(requirements.name)]
    for line in requirements.read_text().splitlines():
        pin = line.split("#")[0].strip()
        if pin:
            digests = sorted(digests_of[normal(re.split(r"[\[=]", pin)[0])])
            lines.append(" \\\n    ".join([pin, *(f"--hash=sha256:{digest}" for digest in digests)]) + "\n")
    requirements.with_suffix(".hashes").write_text("".join(lines))


if __name__ == "__main__":
    for path in [*sorted(ROOT.glob("requirements*.txt")), ROOT / "docs" / "requirements.txt"]:
        write(path)
