"""amb_msgs/RegionMap: a region map, bit for bit; and the goal of the action that builds one."""

from __future__ import annotations

import json
import math
from typing import Any, TypeVar

from amb_core.ground.errors import RegionError
from amb_core.ground.parameters import declarations, validate
from amb_core.recording.messages.arrays import doubles
from amb_core.regions.region_map import BOUNDARIES, Boundary, MapSettings, MapSweep, RegionMap

M = TypeVar("M", bound=Any)

_ONSET_ARRAYS = ("frequency_b", "frequency_c", "frequency_d")
_SWEEP_ARRAYS = (*_ONSET_ARRAYS, "resonance_b", "resonance_c", "resonance_d", "highest_frequency", "steps")
_BEAT_ARRAYS = ("beat_start", "beat_end")
_NUMBERS = ("amplitude", *_ONSET_ARRAYS, "highest_frequency", *_BEAT_ARRAYS)


def region_map_from_message(message: Any) -> RegionMap:
    """The map of a RegionMap message.

    Raises
    ------
    RegionError
        If it has no sweep, or its arrays or texts are not those of a map.
    """
    try:
        _check_map_arrays(message)
        settings, provenance = _map_texts(message)
    except RegionError as problem:
        raise RegionError(f"region map of {len(message.amplitude)} sweeps: {problem}") from None
    beats: list[list[tuple[float, float]]] = [[] for _ in message.amplitude]
    for sweep, start, end in zip(message.beat_sweep, message.beat_start, message.beat_end, strict=True):
        beats[sweep].append((float(start), float(end)))
    onsets = {
        region: (
            getattr(message, f"frequency_{region.name.lower()}"),
            getattr(message, f"resonance_{region.name.lower()}"),
        )
        for region in BOUNDARIES
    }
    sweeps = [
        MapSweep(
            amplitude=float(amplitude),
            boundaries={
                region: Boundary(float(frequency[number]), bool(resonance[number]))
                for region, (frequency, resonance) in onsets.items()
                if not math.isnan(frequency[number])
            },
            beats=tuple(beats[number]),
            highest_frequency=float(message.highest_frequency[number]),
            steps=int(message.steps[number]),
        )
        for number, amplitude in enumerate(message.amplitude)
    ]
    return RegionMap(settings, tuple(sweeps), provenance, bool(message.complete))


def fill_region_map(message: M, region_map: RegionMap) -> M:
    """Set the fields of a RegionMap message to a map, except its stamp; a confirmation is not part of the message."""
    sweeps = region_map.sweeps
    message.complete = region_map.complete
    message.settings = json.dumps(region_map.settings.model_dump())
    message.provenance = json.dumps(region_map.provenance)
    message.amplitude = doubles(region_map.amplitudes)
    message.highest_frequency = doubles([sweep.highest_frequency for sweep in sweeps])
    message.steps = [sweep.steps for sweep in sweeps]
    message.beat_sweep = [number for number, sweep in enumerate(sweeps) for _ in sweep.beats]
    message.beat_start = doubles([low for sweep in sweeps for low, _ in sweep.beats])
    message.beat_end = doubles([high for sweep in sweeps for _, high in sweep.beats])
    for region in BOUNDARIES:
        suffix = region.name.lower()
        setattr(message, f"frequency_{suffix}", doubles(region_map.frequencies(region)))
        resonant = [region in sweep.boundaries and sweep.boundaries[region].resonance for sweep in sweeps]
        setattr(message, f"resonance_{suffix}", resonant)
    return message


def map_settings_from_message(message: Any) -> MapSettings:
    """Settings of a map from the goal of a BuildMap action; there 0, empty and a negative rest mean the default.

    Raises
    ------
    RegionError
        If a value is not allowed; the message gives the allowed values.
    """
    given = {name: getattr(message, name) for name in MapSettings.model_fields}
    asked = {name: value for name, value in given.items() if (value >= 0.0 if name == "rest" else value)}
    return validate(MapSettings, asked, RegionError)


def _check_map_arrays(message: Any) -> None:
    """Raise RegionError if the arrays of a RegionMap message are inconsistent or have impossible values."""
    sweeps = len(message.amplitude)
    most = next(item.maximum for item in declarations(MapSettings) if item.name == "max_sweeps")
    if most is not None and sweeps > most:
        raise RegionError(f"allowed: at most {most:g} sweeps")
    for names, length in ((_SWEEP_ARRAYS, sweeps), (_BEAT_ARRAYS, len(message.beat_sweep))):
        for name in names:
            if len(getattr(message, name)) != length:
                raise RegionError(f"{name} has {len(getattr(message, name))} elements; allowed: {length}")
    if any(number >= sweeps for number in message.beat_sweep):
        raise RegionError(
            f"beat_sweep = {max(message.beat_sweep)} is not the index of a sweep; allowed: 0 to {sweeps - 1}"
        )
    for name in _NUMBERS:
        for value in getattr(message, name):
            # A boundary that does not occur is NaN.
            if not 0.0 <= value < math.inf and not (name in _ONSET_ARRAYS and math.isnan(value)):
                raise RegionError(f"{name} = {value:g}; allowed: finite numbers, 0 or more")
    if 0.0 in message.amplitude:
        raise RegionError("amplitude = 0; allowed: finite numbers above 0")


def _map_texts(message: Any) -> tuple[MapSettings, dict[str, Any]]:
    """Settings and provenance of a RegionMap message from their JSON; RegionError if they are invalid."""
    texts = {}
    for name in ("settings", "provenance"):
        try:
            texts[name] = json.loads(getattr(message, name))
        except (ValueError, RecursionError):
            raise RegionError(f"field {name} is not JSON") from None
        if not isinstance(texts[name], dict):
            raise RegionError(f"field {name} is not a JSON object")
    return validate(MapSettings, texts["settings"], RegionError), texts["provenance"]
