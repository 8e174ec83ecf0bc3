"""Data for identification: experiments from bags and files, made fit for estimation, and checked."""

from amb_core.identification.data.conditioning import advance_inputs, decimate, detrend, restore, split_at_invalid
from amb_core.identification.data.dataset import Experiment, Gap, IdentificationData, merge

__all__ = [
    "Experiment",
    "Gap",
    "IdentificationData",
    "advance_inputs",
    "decimate",
    "detrend",
    "merge",
    "restore",
    "split_at_invalid",
]
