"""A task: the unit of work on a cluster, and of the results on disk."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

R = TypeVar("R")


class Task(ABC, Generic[R]):
    """A computation with a result of type R that depends only on the content of `describe`."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """What determines the result, as plain JSON values: parameters, files they name, version of the code.

        Returns
        -------
        dict of str to object
            JSON values by name.
        """

    @abstractmethod
    def run(self) -> R:
        """Compute the result.

        Returns
        -------
        R
            The result, which depends on `describe` alone.
        """

    @staticmethod
    @abstractmethod
    def to_json(result: R, /) -> dict[str, Any]:
        """A result as JSON values.

        Parameters
        ----------
        result : R
            The result of such a task.

        Returns
        -------
        dict of str to object
            JSON values by name.
        """

    @staticmethod
    @abstractmethod
    def from_json(entry: dict[str, Any], /) -> R:
        """The result that `to_json` wrote.

        Parameters
        ----------
        entry : dict of str to object
            JSON values.

        Returns
        -------
        R
            The result.

        Raises
        ------
        KeyError, TypeError, ValueError
            If they are anything else.
        """

    def key(self) -> str:
        """Checksum of `describe`: tasks with the same key have the same result.

        Returns
        -------
        str
            Hexadecimal digits.
        """
        return hashlib.sha256(json.dumps(self.describe(), sort_keys=True).encode()).hexdigest()
