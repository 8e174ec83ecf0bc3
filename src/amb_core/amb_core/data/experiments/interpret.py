"""Experiments from a table and what is known of it, and a list of what was understood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.clock import Clock, clock_of, resampled
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.description import DataDescription
from amb_core.data.experiments.experiment import Experiment
from amb_core.data.experiments.merging import merge
from amb_core.data.experiments.proposal import unit_at_end
from amb_core.data.experiments.roles import Roles, find_roles
from amb_core.data.tables import Column, Table
from amb_core.data.tables.units import CURRENTS, KNOWN, LENGTHS, TIMES, is_known, si, spelled
from amb_core.ground.errors import IdentificationError

SHORTEST = 20
"""Samples that a stretch between missing ones must have to become an experiment."""
_KINDS = {"currents": CURRENTS, "lengths": LENGTHS, "times": TIMES}
_FAR = {"m": 0.01, "A": 1_000.0}  # beyond what a bearing has


@dataclass(frozen=True)
class SignalRow:
    """A signal as it was understood, for a preview.

    Attributes
    ----------
    signal, role, unit : str
        Name, role and unit as in the file; `unknown` for no unit.
    si_unit : str
        Unit of the data.
    scale : float
        Factor from the one to the other (-).
    samples, missing : int
        Rows, and those without a number.
    rate : float
        Sample rate (Hz).
    low, high : float
        Range, in the unit of the data.
    """

    signal: str
    role: str
    unit: str
    si_unit: str
    scale: float
    samples: int
    missing: int
    rate: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class DescribedData:
    """Data of a file of others.

    Attributes
    ----------
    data : IdentificationData
        The data, in SI units where their units are known.
    rows : tuple of SignalRow
        What each signal was understood as.
    notes : tuple of str
        What was repaired, assumed or looks doubtful.
    description : DataDescription
        All that is needed to read the next file of the same kind without a question.
    """

    data: IdentificationData
    rows: tuple[SignalRow, ...]
    notes: tuple[str, ...]
    description: DataDescription


@dataclass(frozen=True, eq=False)
class _Signal:
    column: Column
    role: str
    label: str
    unit: str  # as in the file
    si_unit: str
    scale: float

    @property
    def values(self) -> NDArray[np.float64]:
        return self.column.values * self.scale if self.scale != 1.0 else self.column.values


def describe_tables(tables: Sequence[Table], description: DataDescription) -> DescribedData:
    """Interpret the tables of several experiments alike.

    Parameters
    ----------
    tables : sequence of Table
        Columns of each experiment.
    description : DataDescription
        What the user says of the columns.

    Returns
    -------
    DescribedData
        The data of all experiments, and how each column was understood.

    Raises
    ------
    IdentificationError
        As for `describe_table`, of the experiment that the message names, or if the experiments have different signals.
    """
    if len(tables) == 1:
        return describe_table(tables[0], description)
    parts = []
    for table in tables:
        try:
            parts.append(describe_table(table, description))
        except IdentificationError as problem:
            problem.args = (f"{table.path}: {problem}",)
            raise
    data = merge(part.data for part in parts)
    signals: dict[tuple[str, str], list[SignalRow]] = {}
    for row in (row for part in parts for row in part.rows):
        signals.setdefault((row.role, row.signal), []).append(row)
    rows = [
        replace(
            same[0],
            samples=sum(row.samples for row in same),
            missing=sum(row.missing for row in same),
            low=min(row.low for row in same),
            high=max(row.high for row in same),
        )
        for same in signals.values()
    ]
    notes = [f"{len(tables)} experiments", *dict.fromkeys(note for part in parts for note in part.notes)]
    return DescribedData(data, tuple(rows), tuple(notes), parts[0].description)


def describe_table(table: Table, description: DataDescription) -> DescribedData:
    """Interpret a table.

    Parameters
    ----------
    table : Table
        Columns of a file.
    description : DataDescription
        What the user says of the columns.

    Returns
    -------
    DescribedData
        The data in SI units, and how each column was understood.

    Raises
    ------
    IdentificationError
        If what the columns are, their sample rate or missing samples leave a question; the message names the option
        that answers it.
    """
    roles = find_roles(table, description)
    signals = _signals(roles, description)
    values = np.column_stack([signal.values for signal in signals])
    time, time_unit = _seconds(roles.time, description)
    given, notes = description.given_sample_time, list(table.notes)
    if given is not None and table.sample_time is not None and abs(given / table.sample_time - 1.0) > 1e-6:
        raise IdentificationError(
            f"sample_time {given:g} s is given, but the file has Ts = {table.sample_time:g} s; correct it or "
            "leave it out"
        )
    given = table.sample_time if given is None else given
    if roles.time is not None:
        notes.append(f"times from column {roles.time.name}, in {time_unit}")
    if time is not None and description.repair == "resample":
        before = len(time)
        time, values = resampled(time, values, given)
        notes.append(f"{before} samples interpolated to {len(time)} at {1.0 / (time[1] - time[0]):.6g} Hz")
    clock = _clock(time, given, len(values))
    notes += clock.notes
    spans = _complete(values, signals, clock, description, notes)
    data = _data(table, values, signals, clock, spans)
    rows = tuple(_row(signal, values[:, index], clock) for index, signal in enumerate(signals))
    notes += [
        f"{row.signal} reaches {max(abs(row.low), abs(row.high)):.3g} {row.si_unit}; is its unit right? (--units)"
        for row in rows
        if max(abs(row.low), abs(row.high)) > _FAR.get(row.si_unit, np.inf)
    ]
    notes += [f"unit of {', '.join(r.signal for r in rows if not r.unit)} unknown, taken as it is (--units)"] * any(
        not row.unit for row in rows
    )
    used = [column.values for column in (*roles.inputs, *roles.outputs, *roles.reference, *filter(None, [roles.time]))]
    unused = [column.name for column in table.columns if not any(column.values is values for values in used)]
    if unused:
        more = f" and {len(unused) - 10} more" if len(unused) > 10 else ""
        which = "" if roles.reference else "; if one is the setpoint: --reference, one for each output"
        notes.append(f"columns not used: {', '.join(unused[:10])}{more}{which}")
    if table.left_out:
        notes.append(f"left out, of another length: {table.left_out}")
    return DescribedData(data, rows, tuple(notes), _completed(description, roles))


def _signals(roles: Roles, description: DataDescription) -> list[_Signal]:
    signals = []
    units = _units_of(description, [*roles.inputs, *roles.outputs, *roles.reference, *filter(None, [roles.time])])
    bare = _bare_units(description, roles)
    for role, letter, kind, columns in (
        ("input", "u", "currents", roles.inputs),
        ("output", "y", "lengths", roles.outputs),
        ("reference", "r", "lengths", roles.reference),
    ):
        for number, column in enumerate(columns, start=1):
            label = column.name if column.named else f"{letter}{number}"
            unit = units.get(column.name, spelled(column.unit)) or bare.get(kind, "")
            unit = unit or unit_at_end(columns, role)
            signals.append(_Signal(column, role, label, unit, *si(unit)))
    return signals


def _units_of(description: DataDescription, columns: Sequence[Column]) -> dict[str, str]:
    """Units that are given for columns by name, as x=mil."""
    given: dict[str, str] = {}
    for item in description.units:
        name, sign, unit = item.rpartition("=")
        if not is_known(unit):
            raise IdentificationError(f"--units {item}: the unit {unit!r} is not known; known: {KNOWN}, V, N")
        if sign:
            match = [
                column.name
                for column in columns
                if name in (column.name, column.heading) or column.name.endswith((f".{name}", f"/{name}"))
            ]
            if not match:
                raise IdentificationError(
                    f"--units {item}: there is no such signal; there are {', '.join(c.name for c in columns)}"
                )
            if other := next((given[one] for one in match if given.get(one, spelled(unit)) != spelled(unit)), None):
                raise IdentificationError(f"--units gives {name} two units, {other} and {unit}; give it one")
            given |= dict.fromkeys(match, spelled(unit))
    return given


def _bare_units(description: DataDescription, roles: Roles) -> dict[str, str]:
    """Units that are given for all columns of a role: lengths of outputs and references, currents of inputs, times."""
    given: dict[str, str] = {}
    for unit in (spelled(item) for item in description.units if "=" not in item):
        kind = next((name for name, known in _KINDS.items() if unit in known), "")
        one = roles.time if kind == "times" else roles.outputs[0] if kind == "lengths" else roles.inputs[0]
        example = f"{one.name if one else 'time'}={unit}"
        if not kind:
            raise IdentificationError(
                f"--units {unit} may be that of inputs or outputs; name the signals that have it, as in --units "
                f"{example}"
            )
        if given.setdefault(kind, unit) != unit:
            raise IdentificationError(
                f"--units gives two units for all {kind}, {given[kind]} and {unit}; name the signals that have one of "
                f"them, as in --units {example}"
            )
    return given


def _seconds(column: Column | None, description: DataDescription) -> tuple[NDArray[np.float64] | None, str]:
    """Times in s, and the unit they had."""
    if column is None:
        return None, ""
    unit = _units_of(description, [column]).get(column.name, "") if _names(description, column) else ""
    bare = next((spelled(item) for item in description.units if "=" not in item and spelled(item) in TIMES), "")
    unit = unit or spelled(column.unit) or bare
    values = column.values
    if not unit:
        if (
            len(values) > 2
            and np.isfinite(values).all()
            and np.all(values == np.round(values))
            and np.ptp(values) > 1.0
        ):
            raise IdentificationError(
                f"column {column.name} has whole numbers without a unit: give --units {column.name}=us (s, ms, us, "
                "ns), or, if it counts the samples, --time none --rate HZ"
            )
        return values, "s (assumed, --units)"
    if unit not in TIMES:
        raise IdentificationError(f"times are in {unit}; allowed: s, ms, us, ns, min; give --units {column.name}=s")
    return values * TIMES[unit], unit


def _names(description: DataDescription, column: Column) -> bool:
    return any(item.rpartition("=")[0] == column.name for item in description.units)


def _clock(time: NDArray[np.float64] | None, given: float | None, rows: int) -> Clock:
    if time is not None:
        return clock_of(time, given)
    if given is None:
        raise IdentificationError(
            "the sample time is not known; give sample_time in s: --sample-time, --rate HZ or --time COLUMN"
        )
    return Clock(given, [(0, rows, 0)])


def _complete(
    values: NDArray[np.float64],
    signals: Sequence[_Signal],
    clock: Clock,
    description: DataDescription,
    notes: list[str],
) -> list[tuple[int, int, int]]:
    """The spans of the clock without rows that are not finite, where the description allows to leave them out."""
    valid = np.asarray(np.isfinite(values).all(axis=1))
    if valid.all():
        return clock.spans
    bad = [signal.label for index, signal in enumerate(signals) if not np.isfinite(values[:, index]).all()]
    rows = np.flatnonzero(~valid)
    lack = f"{len(rows)} of {len(values)} rows lack a number in {', '.join(bad)}"
    spans = []
    for start, stop, step in clock.spans:
        edges = np.flatnonzero(np.diff(valid[start:stop], prepend=False, append=False))
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if last - first >= SHORTEST:
                spans.append((start + first, start + last, step + first))
    if not spans:
        every = np.unique(np.diff(np.flatnonzero(valid)))
        raise IdentificationError(
            f"{lack}, and no stretch between them has {SHORTEST} samples; "
            + (
                f"only every {every[0]}. row has all: write those rows alone to a file, or leave "
                if len(every) == 1
                else "leave "
            )
            + f"{', '.join(bad)} out of --inputs, --outputs and --reference"
        )
    if description.repair != "split":
        raise IdentificationError(
            f"{lack}, the first is row {rows[0]}; give --repair split to use the stretches between them"
        )
    used = sum(stop - start for start, stop, _ in spans)
    notes.append(f"{len(rows)} rows lack a number: {len(spans)} experiments between them, {used} samples")
    return spans


def _data(
    table: Table,
    values: NDArray[np.float64],
    signals: Sequence[_Signal],
    clock: Clock,
    spans: Sequence[tuple[int, int, int]],
) -> IdentificationData:
    u, y, r = ([i for i, s in enumerate(signals) if s.role == role] for role in ("input", "output", "reference"))
    experiments = tuple(
        Experiment(values[a:b, u], values[a:b, y], values[a:b, r] if r else None, first, table.path)
        for a, b, first in spans
    )
    names, units = [signal.label for signal in signals], [signal.si_unit for signal in signals]
    if r and [units[index] for index in r] != [units[index] for index in y]:
        raise IdentificationError(
            f"the reference is in {units[r[0]] or 'an unknown unit'}, the outputs in {units[y[0]] or 'an unknown unit'}"
            "; give --units for both"
        )
    return IdentificationData(
        experiments,
        clock.sample_time,
        *(tuple(source[index] for index in part) for source in (names, units) for part in (u, y)),
        foreign=True,
        clearance={
            signal.label: table.clearance[name]
            for signal in signals
            if signal.role == "output" and (name := signal.column.heading or signal.column.name) in table.clearance
        },
    )


def _row(signal: _Signal, values: NDArray[np.float64], clock: Clock) -> SignalRow:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (np.nan, np.nan)
    missing = len(values) - finite.size + clock.missing
    rate = 1.0 / clock.sample_time
    return SignalRow(
        signal.label, signal.role, signal.unit, signal.si_unit, signal.scale, len(values), missing, rate, low, high
    )


def _completed(description: DataDescription, roles: Roles) -> DataDescription:
    """The description with the roles that were found."""
    return description.with_values(
        inputs=_names_of(roles.inputs) if not description.inputs else None,
        outputs=_names_of(roles.outputs) if not description.outputs else None,
        reference=_names_of(roles.reference) if not description.reference else None,
        time=roles.time.name if roles.time is not None and not description.time else None,
    )


def _names_of(columns: Sequence[Column]) -> list[str]:
    return [column.name for column in columns]
