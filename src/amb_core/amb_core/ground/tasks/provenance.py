"""What determines a result besides its parameters and files: the code and the libraries."""

from __future__ import annotations

import hashlib
import importlib
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path

LIBRARIES = ("llvmlite", "numba", "numpy", "scipy")


@cache
def code_version(package: str = "amb_core") -> str:
    """Checksum of all modules of a package, and of the versions of Python and libraries.

    It includes all modules: a list of those that a result depends on would become wrong unnoticed.
    """
    (root,) = map(Path, importlib.import_module(package).__path__)
    digest = hashlib.sha256(sys.version.encode())
    for library in LIBRARIES:
        digest.update(f"{library}=={version(library)}".encode())
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()
