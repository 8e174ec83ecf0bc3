"""What else than parameters decides a result: the code, the libraries, and the files that parameters name."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path

import amb_core
from amb_core.plant import PlantParameters

LIBRARIES = ("llvmlite", "numba", "numpy", "scipy")


@cache
def code_version(sources: tuple[str, ...]) -> str:
    """Checksum of modules and packages of amb_core (paths below it), and of the versions of Python and libraries."""
    root = Path(amb_core.__file__).parent
    digest = hashlib.sha256(sys.version.encode())
    for library in LIBRARIES:
        digest.update(f"{library}=={version(library)}".encode())
    for source in sources:
        for path in [root / source] if source.endswith(".py") else sorted((root / source).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()


def file_checksums(plant: PlantParameters) -> dict[str, str]:
    """Checksums of the data files of a plant, by path; OSError if one cannot be read."""
    return {
        path: hashlib.sha256(Path(path).read_bytes()).hexdigest()
        for path in (plant.iron.bh_table, plant.flexible_rotor.modal_data)
        if path
    }
