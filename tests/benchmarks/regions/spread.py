"""Cases of one subject, spread over processes."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

Case = TypeVar("Case")
Outcome = TypeVar("Outcome")


def spread(run: Callable[[Case], Outcome], cases: Iterable[Case]) -> list[Outcome]:
    """The outcomes of all cases, in their order; `run` is a function of a module, cases and outcomes can be pickled."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=context) as pool:
        return list(pool.map(run, cases))
