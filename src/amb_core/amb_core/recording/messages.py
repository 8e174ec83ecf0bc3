"""What the messages of amb_msgs carry, as the library's own types.

Fields are taken by name, so that a message may come from ROS or be decoded from a bag.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.errors import BagError, ExcitationError, RegionError
from amb_core.excitation import KINDS, excitation_from_definition, instantaneous_frequency
from amb_core.loop.experiments import AppliedExcitation
from amb_core.loop.records import LoopRecord, PlantRecord
from amb_core.model import StateSpaceModel
from amb_core.parameters import declarations, validate

if TYPE_CHECKING:
    from amb_core.regions import AxisState, Onset, RegionState
    from amb_core.regions.region_map import MapSettings, RegionMap

SHORTEST_SAMPLE_TIME, LONGEST_SAMPLE_TIME = 1e-7, 10.0  # s; wider than any loop, so that nothing downstream overflows
LONGEST_TIME = 2**31 - 1  # s; the seconds of a ROS time stamp are an int32

ParameterValue = bool | int | float | str | list[Any] | None


def block_from_message(message: Any) -> LoopRecord:
    """The samples of a LoopSamples message.

    Raises
    ------
    BagError
        If its arrays differ in length, or its sample time or step is that of no loop.
    """
    where = f"telemetry block of run {message.run} at step {message.first_step}"
    try:
        block = LoopRecord(
            int(message.first_step),
            float(message.sample_time),
            _axes(message.reference_x, message.reference_y),
            _axes(message.position_x, message.position_y),
            _axes(message.current_x, message.current_y),
        )
    except ValueError:
        raise BagError(f"{where}: its arrays must have one length") from None
    if not SHORTEST_SAMPLE_TIME <= block.sample_time <= LONGEST_SAMPLE_TIME:
        raise BagError(
            f"{where}: sample time {block.sample_time} s must be positive; allowed: {SHORTEST_SAMPLE_TIME:g} s to "
            f"{LONGEST_SAMPLE_TIME:g} s"
        )
    if (block.first_step + block.steps) * block.sample_time > LONGEST_TIME:
        raise BagError(f"{where}: its time exceeds the range of a ROS time stamp, {LONGEST_TIME} s")
    return block


def plant_record_from_messages(messages: Sequence[Any]) -> PlantRecord:
    """The record of the PlantState messages of one run, of which there must be at least one.

    Raises
    ------
    BagError
        If their arrays do not have the sizes of their bearings.
    """
    stamps = [message.header.stamp for message in messages]
    shape = len(messages), len(messages[0].contact)
    try:
        return PlantRecord(
            step=np.array([message.step for message in messages], dtype=np.int64),
            time=np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]),
            coil_current=_rows(messages, "coil_current").reshape(*shape, 4),
            flux_density=_rows(messages, "flux_density").reshape(*shape, 8),
            force=np.stack([_rows(messages, f"force_{axis}").reshape(shape) for axis in "xy"], axis=2),
            position=np.stack([_rows(messages, f"position_{axis}").reshape(shape) for axis in "xy"], axis=2),
            contact=np.array([message.contact for message in messages], dtype=np.bool_).reshape(shape),
            contact_force=_rows(messages, "contact_force").reshape(shape),
        )
    except ValueError:
        raise BagError(
            f"states of the plant in run {messages[0].run}: the arrays of each must have the sizes of its bearings"
        ) from None


def excitation_from_message(message: Any) -> AppliedExcitation:
    """The excitation that an ExcitationStatus message answers."""
    return AppliedExcitation(
        run=int(message.run),
        id=int(message.id),
        kind=str(message.kind),
        accepted=bool(message.accepted),
        message=str(message.message),
        first_step=int(message.first_step),
        steps=int(message.steps),
    )


def excitation_frequency_from_message(message: Any) -> NDArray[np.float64]:
    """Instantaneous frequency of each sample of an Excitation message (Hz), shape (steps,); empty where none is known.

    A message of version 0.1 carries it, of later ones the definition has it.
    """
    if hasattr(message, "frequency"):
        return np.asarray(message.frequency, dtype=np.float64)
    if len(message.reference_x) or message.kind not in KINDS:  # a waveform of the sender's own, a stop
        return np.zeros(0)
    try:
        excitation = excitation_from_definition(str(message.kind), str(message.description))
        frequency = instantaneous_frequency(excitation, 1.0 / message.sample_time)
    except (ExcitationError, ZeroDivisionError):  # of a later version, or refused by the controller as well
        return np.zeros(0)
    return np.zeros(0) if frequency is None else frequency


def model_from_message(message: Any) -> StateSpaceModel:
    """The model of a StateSpaceModel message.

    Raises
    ------
    BagError
        If its arrays do not have the sizes that it states.
    IdentificationError
        If a value is not finite.
    """
    n, m, p = int(message.order), int(message.inputs), int(message.outputs)
    shapes = {"a": (n, n), "b": (n, m), "c": (p, n), "d": (p, m), "k": (n, p), "innovation_covariance": (p, p)}
    try:
        matrices = {name: np.asarray(getattr(message, name)).reshape(shape) for name, shape in shapes.items()}
    except ValueError as problem:
        raise BagError(f"model of order {n} with {m} inputs and {p} outputs: {problem}") from None
    return StateSpaceModel(
        **matrices,
        input_offset=np.asarray(message.input_offset),
        output_offset=np.asarray(message.output_offset),
        initial_state=np.asarray(message.initial_state),
        sample_time=float(message.sample_time),
        input_names=tuple(message.input_names),
        output_names=tuple(message.output_names),
        input_units=tuple(getattr(message, "input_units", ())),  # bags of old lack them
        output_units=tuple(getattr(message, "output_units", ())),
        method=str(message.method),
        source=str(message.source),
        samples=int(message.samples),
        fit=np.asarray(message.fit),
    )


def region_state_from_message(message: Any) -> RegionState:
    """The state of a RegionState message; which run it belongs to stays in the message."""
    from amb_core.regions import Region, RegionState  # loads a compiler, which a recorder does not need

    return RegionState(
        step=int(message.step),
        x=_axis_state(message.x),
        y=_axis_state(message.y),
        region=Region(message.region),
        since=_onset(message.since),
        radius=float(message.radius),
        settled=bool(message.settled),
    )


def region_map_from_message(message: Any) -> RegionMap:
    """The map of a RegionMap message.

    Raises
    ------
    RegionError
        If it holds no sweep, or its arrays or texts are not those of a map.
    """
    from amb_core.regions.region_map import Boundary, MapSweep, RegionMap
    from amb_core.regions.region_map.region_map import BOUNDARIES

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


def _check_map_arrays(message: Any) -> None:
    """Raise RegionError if the arrays of a RegionMap message do not belong together or hold what no sweep shows."""
    from amb_core.regions.region_map.settings import MapSettings

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
            f"beat_sweep = {max(message.beat_sweep)} is the index of no sweep; allowed: 0 to {sweeps - 1}"
        )
    for name in _NUMBERS:
        for value in getattr(message, name):
            # A boundary that does not occur is NaN.
            if not 0.0 <= value < math.inf and not (name in _ONSET_ARRAYS and math.isnan(value)):
                raise RegionError(f"{name} holds {value:g}; allowed: finite numbers, 0 or more")
    if 0.0 in message.amplitude:
        raise RegionError("amplitude holds 0; allowed: finite numbers above 0")


_ONSET_ARRAYS = ("frequency_b", "frequency_c", "frequency_d")
_SWEEP_ARRAYS = (*_ONSET_ARRAYS, "resonance_b", "resonance_c", "resonance_d", "highest_frequency", "steps")
_BEAT_ARRAYS = ("beat_start", "beat_end")
_NUMBERS = ("amplitude", *_ONSET_ARRAYS, "highest_frequency", *_BEAT_ARRAYS)


def _map_texts(message: Any) -> tuple[MapSettings, dict[str, Any]]:
    """Settings and provenance of a RegionMap message from their JSON; RegionError if they are none."""
    from amb_core.regions.region_map.settings import MapSettings

    texts = {}
    for name in ("settings", "provenance"):
        try:
            texts[name] = json.loads(getattr(message, name))
        except (ValueError, RecursionError):
            raise RegionError(f"field {name} is not JSON") from None
        if not isinstance(texts[name], dict):
            raise RegionError(f"field {name} is no JSON object")
    return validate(MapSettings, texts["settings"], RegionError), texts["provenance"]


def map_settings_from_message(message: Any) -> MapSettings:
    """Settings of a map from the goal of a BuildMap action, in which 0, empty and a negative rest ask for the default.

    Raises
    ------
    RegionError
        If a value is not allowed; the message says what is.
    """
    from amb_core.regions.region_map import MapSettings

    given = {name: getattr(message, name) for name in MapSettings.model_fields}
    asked = {name: value for name, value in given.items() if (value >= 0.0 if name == "rest" else value)}
    return validate(MapSettings, asked, RegionError)


def parameters_from_messages(messages: Iterable[Any]) -> dict[str, ParameterValue]:
    """Names and values of rcl_interfaces/Parameter messages; None for a parameter that is not set."""
    return {message.name: _parameter_value(message.value) for message in messages}


def _parameter_value(value: Any) -> ParameterValue:
    """Value of a rcl_interfaces/ParameterValue: its type counts these fields from 1 (see ParameterType)."""
    fields = (
        "bool_value",
        "integer_value",
        "double_value",
        "string_value",
        "byte_array_value",
        "bool_array_value",
        "integer_array_value",
        "double_array_value",
        "string_array_value",
    )
    if not 1 <= value.type <= len(fields):
        return None
    content = getattr(value, fields[value.type - 1])
    return list(content) if fields[value.type - 1].endswith("array_value") else content


def _axis_state(message: Any) -> AxisState:
    from amb_core.regions import AxisState, Region

    features = {name: getattr(message, name) for name in AxisState.__dataclass_fields__}
    return AxisState(**features | {"region": Region(message.region), "since": _onset(message.since)})


def _onset(message: Any) -> Onset:
    from amb_core.regions import Onset

    return Onset(int(message.step), float(message.time), float(message.input_frequency), bool(message.resonance))


def _rows(messages: Sequence[Any], name: str) -> NDArray[np.float64]:
    return np.array([getattr(message, name) for message in messages], dtype=np.float64)


def _axes(x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
    return np.column_stack([np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)])
