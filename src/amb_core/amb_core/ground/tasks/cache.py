"""Results on disk: one file each, named by the key of its task, written immediately and atomically."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import tempfile
from pathlib import Path
from typing import Any

from amb_core.ground.errors import AmbError, TaskError
from amb_core.ground.tasks.task import R, Task

logger = logging.getLogger(__name__)


class ResultCache:
    """Results in a folder; any number of processes may use it at once.

    Problems with the folder do not stop the work: results that cannot be read are computed again, results that cannot
    be written are not kept. The log has a warning then.

    Parameters
    ----------
    folder : Path
        Created at the first write.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._failed = False
        self._damaged: set[str] = set()

    def path(self, key: str) -> Path:
        """File of a result.

        Parameters
        ----------
        key : str
            Key of a task.

        Returns
        -------
        Path
            The file, whether it exists or not.
        """
        return self.folder / f"{key}.json"

    def load(self, key: str, task: Task[R]) -> R | None:
        """The result of a task; None if there is none or its file is damaged.

        Parameters
        ----------
        key : str
            Key of the task.
        task : Task[R]
            The task.

        Returns
        -------
        R or None
            The result, if it can be read.
        """
        path = self.path(key)
        try:
            entry = json.loads(path.read_text())
            if entry["checksum"] != _checksum(entry["result"]):
                raise ValueError("its checksum is wrong")
            return task.from_json(entry["result"])
        except FileNotFoundError:
            return None
        except OSError as problem:
            logger.warning("result %s cannot be read (%s); it is computed again", path, problem.strerror)
        except (ValueError, KeyError, TypeError, AttributeError) as problem:
            self._damaged.add(key)
            logger.warning("result %s is damaged (%s); it is computed again", path, problem)
        return None

    def store(self, key: str, task: Task[R], result: R) -> None:
        """Write a result; readers see all of it or nothing.

        Parameters
        ----------
        key : str
            Key of the task.
        task : Task[R]
            The task.
        result : R
            Its result.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        content = task.to_json(result)
        entry = {"checksum": _checksum(content), "result": content, "task": task.describe()}
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=self.folder, suffix=".part", delete=False) as file:
            temporary = Path(file.name)
        try:
            temporary.write_text(json.dumps(entry, indent=1))
            temporary.replace(self.path(key))
        except OSError:
            temporary.unlink(missing_ok=True)
            raise

    def ensure(self, key: str, task: Task[R], result: R) -> None:
        """Write a result that is missing or damaged, as after a worker on another machine; a failure only warns.

        Parameters
        ----------
        key : str
            Key of the task.
        task : Task[R]
            The task.
        result : R
            Its result.
        """
        if self._failed or (key not in self._damaged and self.path(key).exists()):
            return
        try:
            self.store(key, task, result)
        except OSError as problem:
            self._failed = True
            logger.warning("results cannot be kept in %s: %s", self.folder, problem.strerror)


def compute(task: Task[R], key: str, folder: Path) -> R:
    """Run a task in the process of a worker, and keep the result at once; if that fails, the driver will try.

    Raises
    ------
    TaskError
        If the worker has another version of the code or of a file than the driver, or the task fails.
    """
    try:
        if task.key() != key:
            raise TaskError(
                "a worker has another version of amb_core, its libraries or the plant's data files than this program; "
                "restart both"
            )
        result = task.run()
    except (AmbError, OSError) as problem:
        raise TaskError(str(problem)) from None
    with contextlib.suppress(OSError):
        ResultCache(folder).store(key, task, result)
    return result


def _checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
