"""Writes docs/reference/licences.md: every package that the requirements pin, with its licence as an SPDX expression.

A package names its licence in its metadata, or in the package.xml that ROS installs with it. The packages of
requirements.txt are read where they are installed; those of the extras are installed into a temporary folder first.
Run it after a change of pins. It fails on a licence that `ALLOWED` does not have: decide, and say why in `DECIDED`.
"""

from __future__ import annotations

import re
import subprocess
import sys
import sysconfig
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "licences.md"
ALLOWED = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0",
    "ISC", "MIT", "MIT-0", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Unlicense", "Zlib",
}  # fmt: skip
DECIDED = {
    "apsw": ("Zlib", "its metadata leave the choice open; its file LICENSE is that of zlib"),
    "ctrefprop": ("LicenseRef-NIST", "software of NIST, free to use, change and pass on with its notice"),
    "docutils": ("BSD-2-Clause", "only its Emacs mode is under the GPL; it is not installed"),
    "empy": ("LGPL-2.1-or-later", "a tool of the build, not linked with; its metadata hold an empty placeholder"),
    "ros-fastcdr": ("Apache-2.0", "names none in its metadata; from its file LICENSE"),
    "ros-fastrtps": ("Apache-2.0", "names none in its metadata; from its file LICENSE"),
    "setuptools": ("MIT", "names none in its metadata; from its file LICENSE"),
}
"""What no rule reads from the metadata: the licence, and why it is taken."""

_SPDX = (  # the words of metadata, in the order in which they are tried
    (r"^\(?[\w.+-]+( (AND|OR|WITH) [\w.+-]+)+\)?$", None),
    (r"mozilla|mpl", "MPL-2.0"),
    (r"python software|^psf", "PSF-2.0"),
    (r"bsd[- ]?2|2[- ]clause", "BSD-2-Clause"),
    (r"bsd[- ]?3|3[- ]clause|new bsd", "BSD-3-Clause"),
    (r"apache", "Apache-2.0"),
    (r"mit-0|mit-cmu|0bsd", None),
    (r"\bmit\b", "MIT"),
    (r"\bisc\b", "ISC"),
    (r"zlib", "Zlib"),
    (r"boost", "BSL-1.0"),
    (r"bsd", "BSD"),
)


def normal(name: str) -> str:
    """A name as the index spells it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(requirements: Path) -> dict[str, str]:
    """Version of each package that a file pins, by normal name."""
    pinned = re.findall(r"^([\w.-]+)(?:\[.*?\])?==([\w.]+)", requirements.read_text(), flags=re.M)
    return {normal(name): version for name, version in pinned}


def spdx(words: str) -> str:
    """SPDX expression for the words of one licence; the words themselves where no rule knows them."""
    for pattern, expression in _SPDX:
        if re.search(pattern, words, flags=re.I):
            return expression or words.strip("()")
    return words


def licence(package: Distribution, share: Path) -> str:
    """SPDX expression of an installed package; empty if it names none."""
    metadata = package.metadata
    if expression := metadata.get("License-Expression"):
        return expression
    classified = [line.split("::")[-1] for line in metadata.get_all("Classifier", []) if line.startswith("License ::")]
    words = (metadata.get("License") or "").strip()
    short = words if 0 < len(words) <= 60 and words != "UNKNOWN" else ""  # more is the text of the licence
    manifest = (
        share / normal(metadata["Name"]).removeprefix("ros-").removeprefix("jazzy-").replace("-", "_") / "package.xml"
    )
    declared = [one for one in (short, *classified) if one and not one.strip().startswith(("DFSG", "OSI"))][:1]
    if not declared and manifest.is_file():
        declared = [str(item.text) for item in ElementTree.parse(manifest).getroot().findall("license")]
    return " AND ".join(dict.fromkeys(spdx(one.strip()) for one in declared))


def parts(expression: str) -> list[str]:
    """The licences of an expression."""
    return [one.strip("() ") for one in re.split(r" AND | OR ", expression)]


def rows(requirements: Path, folder: Path, share: Path) -> Iterator[tuple[str, str, str, str]]:
    """Name, version, licence and reason of each package that a file of requirements pins.

    Raises
    ------
    SystemExit
        If a licence is neither allowed nor decided.
    """
    wanted = pins(requirements)
    for package in sorted(distributions(path=[str(folder)]), key=lambda item: normal(item.metadata["Name"])):
        key = normal(package.metadata["Name"])
        if wanted.pop(key, None) is None:
            continue
        expression, reason = DECIDED.get(key) or (licence(package, share), "")
        if not reason and not set(parts(expression)) <= ALLOWED:
            raise SystemExit(f"{key} {package.version}: licence {expression or 'not named'!r}; allowed: {ALLOWED}")
        yield key, package.version, expression, reason
    if wanted:
        raise SystemExit(f"{requirements.name} pins what is not installed: {', '.join(wanted)}")


def main() -> None:
    """Write the page."""
    lines = ["# Licences of what is installed", ""]
    lines += [
        "The workbench is under Apache-2.0. It contains no code of the packages below; `make setup` installs those of",
        "`requirements.txt`, an extra installs its own only where it is asked for, and `make docs` those of",
        "`docs/requirements.txt`. Made by `scripts/licences.py`.",
    ]
    for path in [*sorted(ROOT.glob("requirements*.txt")), ROOT / "docs" / "requirements.txt"]:
        with tempfile.TemporaryDirectory() as folder:
            installed, share = Path(sysconfig.get_path("purelib")), Path(sys.prefix, "share")
            if path != ROOT / "requirements.txt":
                installed = Path(folder)
                install = [sys.executable, "-m", "pip", "install", "-qq", "--no-deps", "--target", folder]
                subprocess.run([*install, "-r", str(path)], check=True)
            lines += [
                "",
                f"## {path.relative_to(ROOT)}",
                "",
                "| package | version | licence (SPDX) | why |",
                "|---|---|---|---|",
            ]
            lines += [f"| {' | '.join(row)} |" for row in rows(path, installed, share)]
    PAGE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
