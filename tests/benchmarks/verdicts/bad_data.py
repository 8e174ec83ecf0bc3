"""Bad data are named for what is wrong with them, where and when; clean data are not accused.

Records of random loops of one to four axes, each spoilt in one way, with the controller of the experiment known or, for
half of those of the faults that show without it, not. A fault counts as named if its check warns, with the right signal
and step, and no other check of faults does.

    python -m tests.benchmarks.verdicts.bad_data --seed 2
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import Finding, IdentificationData, Severity
from amb_core.data.experiments.checks import check_finite, check_recording
from amb_core.identification.controller_check import check_controller
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord
from tests.benchmarks.verdicts.alone import start_alone
from tests.benchmarks.verdicts.drawn_loops import DrawnLoop, draw_record

EACH, CLEAN, SEED = 5, 100, 47
NEAR = 3  # steps between a fault and the step that is named

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class Spoilt:
    """Data with a fault: the check and the words that name it, the signal and the steps that it is in."""

    data: IdentificationData
    controller: KnownController | None
    check: str
    words: str = ""
    signal: str = ""
    step: int | None = None

    @property
    def warnings(self) -> list[Finding]:
        """What is found."""
        findings = [check_finite(self.data)]
        if findings[0].severity is not Severity.ERROR:
            findings += check_recording(self.data)
            findings.append(check_controller(self.data, self.controller))
        return [finding for finding in findings if finding.severity is not Severity.INFO]


def run(quick: bool, progress: Callable[[int, int], None], seed: int = SEED) -> dict[str, int]:
    """How many faults are named, and how many clean records are accused."""
    each, clean = (1, 2) if quick else (EACH, CLEAN)
    cases, total = 0, each * len(KINDS) + clean
    count = accused = 0
    for place, kind in enumerate(KINDS):
        for number in range(each):
            count += named(spoil(kind, np.random.default_rng([seed, place, number])))
            cases += 1
            progress(cases, total)
    for number in range(clean):
        accused += bool(draw_clean(np.random.default_rng([seed, len(KINDS), number])).warnings)
        progress(cases + number + 1, total)
    return {"cases": cases, "named": count, "clean": clean, "accused": accused}


def named(case: Spoilt) -> bool:
    """Whether the fault is named, and no other one; a controller may also be reported not to fit."""
    warnings = case.warnings
    others = {finding.check for finding in warnings} - {case.check, "controller"}
    right = [finding for finding in warnings if finding.check == case.check]
    if others or not right:
        return False
    finding = right[0]
    return case.words in finding.text and case.signal in finding.text and _near(finding.where, case.step)


def _near(where: str, step: int | None) -> bool:
    """Whether the first step of a text is the one of the fault, but for some."""
    words = where.replace(",", " ").split()
    steps = [int(after) for word, after in itertools.pairwise(words) if word in ("step", "steps")]
    return step is None or (bool(steps) and abs(steps[0] - step) <= NEAR)


def draw_clean(random: np.random.Generator) -> Spoilt:
    """A record without a fault, half of them written with six digits or read by a converter of 16 bits."""
    record, loop = draw_record(random)
    return Spoilt(_data(_recorded(record, random)), loop.controller if random.random() < 0.7 else None, "")


def spoil(kind: str, random: np.random.Generator) -> Spoilt:
    """A record with a fault of a kind."""
    record, loop = draw_record(random, axes=int(random.integers(2, 5)) if kind in OF_SEVERAL_AXES else None)
    if kind not in AFTER_RECORDING:
        record = _recorded(record, random)
    case = KINDS[kind](record, loop, random)
    known = kind in OF_THE_CONTROLLER or random.random() < 0.5
    return case if known else replace(case, controller=None)


def _recorded(record: LoopRecord, random: np.random.Generator) -> LoopRecord:
    """As the loop computed it, as a text file of eight digits keeps it, or from step 0."""
    choice = random.integers(3)
    if choice == 0:
        return record
    if choice == 1:
        return replace(record, first_step=0)
    signals = {}
    for name in ("reference", "position", "current"):
        values = getattr(record, name)
        step = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-12))) - 7.0)
        signals[name] = np.round(values / step) * step
    return replace(record, **signals)


def _data(record: LoopRecord) -> IdentificationData:
    return IdentificationData.from_record(record)


def _changed(record: LoopRecord, name: str, rows: slice | Arrays, axis: int, values: Arrays | float) -> LoopRecord:
    signal = getattr(record, name).copy()
    signal[rows, axis] = values
    return replace(record, **{name: signal})


def _inside(record: LoopRecord, random: np.random.Generator, length: int = 1) -> int:
    return int(random.integers(200, record.steps - length - 200))


def _frozen(name: str) -> Callable[[LoopRecord, DrawnLoop, np.random.Generator], Spoilt]:
    def spoilt(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
        axis, length = int(random.integers(len(record.axes))), round(0.06 / record.sample_time)
        row = _inside(record, random, length)
        held = getattr(record, name)[row, axis]
        record = _changed(record, name, slice(row, row + length), axis, held)
        signal = ("i_" if name == "current" else "") + record.axes[axis]
        return Spoilt(_data(record), loop.controller, "frozen", "", signal, record.first_step + row)

    return spoilt


def _dropped(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    kept = random.random(record.steps) >= 0.01
    kept[:100] = True
    return Spoilt(_data(_rows(record, kept)), loop.controller, "missing", "", "", _first(record, ~kept))


def _gap(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    length = int(random.integers(2, 60))
    row = _inside(record, random, length)
    kept = np.ones(record.steps, bool)
    kept[row : row + length] = False
    return Spoilt(_data(_rows(record, kept)), loop.controller, "missing", "", "", record.first_step + row)


def _first(record: LoopRecord, rows: NDArray[np.bool_]) -> int:
    return record.first_step + int(np.argmax(rows))


def _rows(record: LoopRecord, kept: NDArray[np.bool_]) -> LoopRecord:
    signals = {name: getattr(record, name)[kept] for name in ("reference", "position", "current")}
    return replace(record, **signals)


def _repeated(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    stale = random.random(record.steps) < 0.01
    stale[:100] = False
    source = np.maximum.accumulate(np.where(stale, 0, np.arange(record.steps)))
    signals = {name: getattr(record, name)[source] for name in ("position", "current")}
    return Spoilt(_data(replace(record, **signals)), loop.controller, "repeated", "", "", _first(record, stale))


def _outlier(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    axis, row = int(random.integers(len(record.axes))), _inside(record, random)
    record = _changed(record, "position", slice(row, row + 1), axis, random.choice([-1e-3, 1e-3]))
    return Spoilt(_data(record), loop.controller, "outliers", "", record.axes[axis], record.first_step + row)


def _current_outlier(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    axis, row = int(random.integers(len(record.axes))), _inside(record, random)
    size = record.current[row, axis] + random.choice([-3.0, 3.0]) * np.ptp(record.current[:, axis])
    record = _changed(record, "current", slice(row, row + 1), axis, size)
    signal = f"i_{record.axes[axis]}"
    return Spoilt(_data(record), loop.controller, "outliers", "", signal, record.first_step + row)


def _dropouts(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    axis, rail = int(random.integers(len(record.axes))), float(random.choice([-300e-6, 300e-6]))
    rows = np.sort(random.choice(np.arange(200, record.steps - 200, 50), 8, replace=False))
    for row in rows:
        record = _changed(record, "position", slice(row, row + int(random.integers(1, 4))), axis, rail)
    return Spoilt(_data(record), loop.controller, "outliers", "", record.axes[axis], record.first_step + int(rows[0]))


def _exchanged(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    data = _data(record)
    (item,) = data.experiments
    item = replace(item, inputs=item.outputs, outputs=item.inputs)
    if random.random() < 0.5:
        return Spoilt(replace(data, experiments=(item,)), loop.controller, "roles", "exchanged")
    units = {"input_units": data.output_units, "output_units": data.input_units}
    return Spoilt(replace(data, experiments=(item,), **units), None, "roles", "exchanged")


def _shifted(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    shift = int(random.choice([-1, 1]))
    record = replace(record, current=np.roll(record.current, shift, axis=0))
    record = record.window(record.first_step + 1, record.steps - 2)
    words = "1 sample later" if shift > 0 else "1 sample earlier"
    return Spoilt(_data(record), loop.controller, "controller", words)


def _doubled(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    record = replace(record, sample_time=2.0 * record.sample_time)
    controller: ControllerParameters = loop.controller.at_rate(1.0 / record.sample_time)
    return Spoilt(_data(record), controller, "controller", "a sample time of")


def _saturated(name: str) -> Callable[[LoopRecord, DrawnLoop, np.random.Generator], Spoilt]:
    def spoilt(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
        axis = int(random.integers(len(record.axes)))
        signal = getattr(record, name)[:, axis]
        low, high = np.quantile(signal, [0.0, random.uniform(0.9, 0.97)])
        record = _changed(record, name, slice(None), axis, np.clip(signal, low, high))
        label = ("i_" if name == "current" else "") + record.axes[axis]
        return Spoilt(_data(record), loop.controller, "clipping", "", label)

    return spoilt


def _quantised(name: str) -> Callable[[LoopRecord, DrawnLoop, np.random.Generator], Spoilt]:
    def spoilt(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
        axis = int(random.integers(len(record.axes)))
        signal = getattr(record, name)[:, axis]
        step = random.uniform(0.15, 0.6) * float(signal.std())
        record = _changed(record, name, slice(None), axis, np.round(signal / step) * step)
        label = ("i_" if name == "current" else "") + record.axes[axis]
        return Spoilt(_data(record), loop.controller, "quantised", "", label)

    return spoilt


def _invalid(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    axis, row = int(random.integers(len(record.axes))), _inside(record, random)
    record = _changed(record, "position", slice(row, row + 5), axis, np.nan)
    return Spoilt(_data(record), loop.controller, "finite", "", record.axes[axis], record.first_step + row)


def _reversed(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    axis = int(random.integers(len(record.axes)))
    record = _changed(record, "position", slice(None), axis, -record.position[:, axis])
    return Spoilt(_data(record), loop.controller, "controller", f"the sign of the position {record.axes[axis]}")


def _swapped(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    first, second = random.choice(len(record.axes), 2, replace=False)
    order = np.arange(len(record.axes))
    order[[first, second]] = second, first
    record = replace(record, position=record.position[:, order])
    return Spoilt(_data(record), loop.controller, "controller", "positions swapped", record.axes[first])


def _in_micrometres(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    record = replace(record, position=1e6 * record.position)
    return Spoilt(_data(record), loop.controller, "roles", "unit", record.axes[0])


def _held(record: LoopRecord, loop: DrawnLoop, random: np.random.Generator) -> Spoilt:
    factor = int(random.integers(2, 5))
    source = np.arange(record.steps) // factor * factor
    signals = {name: getattr(record, name)[source] for name in ("position", "current")}
    return Spoilt(_data(replace(record, **signals)), loop.controller, "sample time", f"{factor} samples")


KINDS: dict[str, Callable[[LoopRecord, DrawnLoop, np.random.Generator], Spoilt]] = {
    "frozen sensor": _frozen("position"),
    "frozen current": _frozen("current"),
    "1 % of the rows dropped": _dropped,
    "a block of rows dropped": _gap,
    "1 % of the rows repeated": _repeated,
    "an outlier of 1 mm": _outlier,
    "an outlier of a current": _current_outlier,
    "dropouts of a sensor": _dropouts,
    "inputs and outputs exchanged": _exchanged,
    "currents shifted": _shifted,
    "sample time doubled": _doubled,
    "a saturated sensor": _saturated("position"),
    "a saturated current": _saturated("current"),
    "a quantised position": _quantised("position"),
    "a quantised current": _quantised("current"),
    "invalid values": _invalid,
    "the sign of a sensor": _reversed,
    "positions swapped": _swapped,
    "micrometres taken for metres": _in_micrometres,
    "held samples": _held,
}
OF_SEVERAL_AXES = ("positions swapped",)
OF_THE_CONTROLLER = ("currents shifted", "sample time doubled", "the sign of a sensor", "positions swapped")
AFTER_RECORDING = ("a quantised position", "a quantised current")  # a record of them has no more digits

if __name__ == "__main__":
    start_alone(run)
