"""The tutorial as somebody follows it, from an empty folder: what it states, and what of that comes out."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path
from typing import Any

from domain_coordinator import domain_id

from tests.docs.pages import reader
from tests.docs.tutorial import follow


def measure(sections: int | None = None) -> dict[str, Any]:
    """Statements of the page, or of its first sections, and how many of them were reproduced."""
    with (
        tempfile.TemporaryDirectory() as folder,
        domain_id() as domain,
        contextlib.chdir(folder),
        reader(Path(folder), domain) as somebody,
    ):
        walk = follow(somebody, sections)
    return {
        "statements": len(walk.reproduced) + len(walk.missed),
        "reproduced": len(walk.reproduced),
        "missed": walk.missed,
        "commands": walk.commands,
        "seconds": round(walk.seconds, 1),
    }
