"""Region maps as messages, bit for bit; `amb_core.recording.messages.region_map_from_message` is the way back."""

from __future__ import annotations

import json
from array import array

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import ArrayLike

from amb_core.regions.region_map import RegionMap
from amb_core.regions.region_map.region_map import BOUNDARIES
from amb_msgs.msg import RegionMap as RegionMapMessage


def region_map_to_message(region_map: RegionMap, stamp: Time) -> RegionMapMessage:
    """The message of a map."""
    sweeps = region_map.sweeps
    message = RegionMapMessage(
        complete=region_map.complete,
        settings=json.dumps(region_map.settings.model_dump()),
        provenance=json.dumps(region_map.provenance),
        amplitude=_doubles(region_map.amplitudes),
        highest_frequency=_doubles([sweep.highest_frequency for sweep in sweeps]),
        steps=[sweep.steps for sweep in sweeps],
        beat_sweep=[number for number, sweep in enumerate(sweeps) for _ in sweep.beats],
        beat_start=_doubles([low for sweep in sweeps for low, _ in sweep.beats]),
        beat_end=_doubles([high for sweep in sweeps for _, high in sweep.beats]),
    )
    for region in BOUNDARIES:
        suffix = region.name.lower()
        setattr(message, f"frequency_{suffix}", _doubles(region_map.frequencies(region)))
        resonant = [region in sweep.boundaries and sweep.boundaries[region].resonance for sweep in sweeps]
        setattr(message, f"resonance_{suffix}", resonant)
    message.header.stamp = stamp
    return message


def _doubles(values: ArrayLike) -> array[float]:
    return array("d", np.asarray(values, dtype=np.float64).tobytes())
