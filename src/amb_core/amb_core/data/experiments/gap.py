"""Samples that are missing between experiments of one run."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

from amb_core.data.experiments.experiment import Experiment


@dataclass(frozen=True)
class DataGap:
    """Samples that are missing between two experiments of one source, from `first_step` up to, not including, `stop`.

    Attributes
    ----------
    source : str
        The run in which they are missing.
    first_step, stop : int
        First missing sample, and the one after the last.
    """

    source: str
    first_step: int
    stop: int

    @property
    def steps(self) -> int:
        """Number of missing samples."""
        return self.stop - self.first_step


def gaps_between(experiments: Iterable[Experiment]) -> list[DataGap]:
    """The gaps between experiments of one source, in order.

    Parameters
    ----------
    experiments : iterable of Experiment
        Experiments of any sources, in any order.

    Returns
    -------
    list of DataGap
        The gaps.
    """
    ordered = sorted(experiments, key=lambda experiment: (experiment.source, experiment.first_step))
    return [
        DataGap(before.source, before.stop, after.first_step)
        for before, after in itertools.pairwise(ordered)
        if before.source == after.source and before.stop < after.first_step
    ]
