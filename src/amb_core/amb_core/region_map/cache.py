"""Finished sweeps on disk: one file each, named by the key of its task, written at once and as a whole."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import tempfile
from pathlib import Path
from typing import Any

from amb_core.errors import PlantError, RegionError
from amb_core.region_map.region_map import MapSweep, sweep_from_json, sweep_to_json
from amb_core.region_map.sweep_run import SweepTask, run_sweep

logger = logging.getLogger(__name__)


def default_folder() -> Path:
    """Folder of finished sweeps for this user: amb/region_map in the cache folder of the XDG base directories."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "amb" / "region_map"


class SweepCache:
    """Finished sweeps in a folder; any number of processes may use it at once.

    What goes wrong with the folder does not stop a map: what cannot be read is computed again, what cannot be written
    is not kept, and a warning in the log says so.

    Parameters
    ----------
    folder : Path
        Made when first written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._failed = False

    def path(self, key: str) -> Path:
        """File of a sweep."""
        return self.folder / f"{key}.json"

    def load(self, key: str) -> MapSweep | None:
        """The sweep of a key; None if it is not there or its file is damaged."""
        path = self.path(key)
        try:
            entry = json.loads(path.read_text())
            if entry["checksum"] != _checksum(entry["sweep"]):
                raise ValueError("its checksum is wrong")
            return sweep_from_json(entry["sweep"])
        except FileNotFoundError:
            return None
        except OSError as problem:
            logger.warning("finished sweep %s cannot be read (%s); it is computed again", path, problem.strerror)
        except (ValueError, KeyError, TypeError, AttributeError) as problem:
            logger.warning("finished sweep %s is damaged (%s); it is computed again", path, problem)
        return None

    def store(self, key: str, task: SweepTask, sweep: MapSweep) -> None:
        """Write a sweep; readers see all of it or nothing.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        content = sweep_to_json(sweep)
        entry = {"checksum": _checksum(content), "sweep": content, "task": task.describe()}
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=self.folder, suffix=".part", delete=False) as file:
            temporary = Path(file.name)
        try:
            temporary.write_text(json.dumps(entry, indent=1))
            temporary.replace(self.path(key))
        except OSError:
            temporary.unlink(missing_ok=True)
            raise

    def ensure(self, key: str, task: SweepTask, sweep: MapSweep) -> None:
        """Write a sweep that is not there yet, as a worker on another machine leaves it; a failure is but a warning."""
        if self._failed or self.path(key).exists():
            return
        try:
            self.store(key, task, sweep)
        except OSError as problem:
            self._failed = True
            logger.warning("finished sweeps cannot be kept in %s: %s", self.folder, problem.strerror)


def compute(task: SweepTask, key: str, folder: Path) -> MapSweep:
    """Run a sweep in the process of a worker, and keep the result at once; if that fails, the driver will try.

    Raises
    ------
    RegionError
        If the worker has another version of the code or of a file than the driver, or the sweep fails.
    """
    try:
        if task.key() != key:
            raise RegionError(
                "a worker has another version of amb_core, its libraries or the plant's data files than this program; "
                "start both anew"
            )
        sweep = run_sweep(task)
    except (PlantError, OSError) as problem:
        raise RegionError(str(problem)) from None
    with contextlib.suppress(OSError):
        SweepCache(folder).store(key, task, sweep)
    return sweep


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
