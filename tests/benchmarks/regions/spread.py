"""Cases of one subject, spread over processes."""

from __future__ import annotations

import functools
import multiprocessing
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

Case = TypeVar("Case")
Outcome = TypeVar("Outcome")


def spread(run: Callable[[Case], Outcome], cases: Iterable[Case]) -> list[Outcome]:
    """The outcomes of all cases, in their order; `run` is a function of a module, cases and outcomes can be pickled."""
    return list(_pool().map(run, cases))


@functools.cache
def _pool() -> ProcessPoolExecutor:
    """Processes for all subjects of a run."""
    return ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn"))
