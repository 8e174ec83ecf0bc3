"""Several data sets in one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from amb_core.data.experiments.dataset import IdentificationData, require_data
from amb_core.ground.errors import IdentificationError
from amb_core.ground.sample_times import difference, same_sample_time


def merge(datasets: Iterable[IdentificationData]) -> IdentificationData:
    """The experiments of several data sets in one, each with its own initial state.

    Parameters
    ----------
    datasets : iterable of IdentificationData
        Data with the same signals and sample time.

    Returns
    -------
    IdentificationData
        All experiments, in this order.

    Raises
    ------
    IdentificationError
        If there is none, or if sample time, names or units differ.
    """
    merged = list(datasets) if isinstance(datasets, Iterable) else [datasets]
    for data in merged:
        require_data(data)
    if not merged:
        raise IdentificationError("there are no data to merge")
    first = merged[0]
    for number, other in enumerate(merged[1:], start=2):
        if not same_sample_time(other.sample_time, first.sample_time):
            raise IdentificationError(
                f"data set {number} has the sample time {other.sample_time:g} s, the first {first.sample_time:g} s; "
                "only data of one sample time can be merged: decimate the faster one; "
                + difference(other.sample_time, first.sample_time)
            )
        for what in ("input_names", "output_names", "input_units", "output_units"):
            mine, theirs = getattr(first, what), getattr(other, what)
            if mine != theirs:
                raise IdentificationError(
                    f"data set {number} has the {what.replace('_', ' ')} {', '.join(theirs)}, "
                    f"the first {', '.join(mine)}; they must be the same"
                )
    experiments = tuple(item for data in merged for item in data.experiments)
    return replace(first, experiments=experiments, foreign=any(data.foreign for data in merged))
