"""Is this the controller of these currents? Wrong controllers are named for what is wrong with them, right ones not.

Records of random loops of one to four axes, half of them written with six digits, with a controller that differs from
that of the experiment in one thing; a third of those in which the derivative plays no role are linear laws.

    python -m tests.benchmarks.verdicts.controllers --seed 2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from amb_core.data.experiments import Finding, IdentificationData, Severity
from amb_core.identification.controller_check import check_controller
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_control import LinearControllerParameters, pd_as_linear
from amb_core.loop.records import LoopRecord
from tests.benchmarks.verdicts.alone import start_alone
from tests.benchmarks.verdicts.drawn_loops import draw_record

EACH, SEED = 20, 43
WORDS = {
    "right": "",
    "proportional gain": "other gains",
    "derivative gain": "other gains",
    "all gains": "other gains",
    "sign": "sign of",
    "swapped axes": "axes swapped",
    "currents later": "later than the positions",
    "currents earlier": "earlier than the positions",
    "derivative": "the derivative on the",
    "filter": "derivative filter",
    "sample time": "a sample time of",
    "constant": "a constant added",
}
"""The kinds, each with the words that name it."""
OF_LINEAR_LAWS = ("right", "all gains", "sign", "swapped axes", "currents later", "currents earlier")


@dataclass(frozen=True)
class Claimed:
    """A record and the controller that it is said to come from."""

    kind: str
    record: LoopRecord
    controller: KnownController

    @property
    def finding(self) -> Finding:
        """What is found."""
        return check_controller(IdentificationData.from_record(self.record), self.controller)


def run(quick: bool, progress: Callable[[int, int], None], seed: int = SEED) -> dict[str, int]:
    """How many controllers are named for what they are."""
    each, count, cases = (1 if quick else EACH), 0, 0
    for kind in WORDS:
        for number in range(each):
            count += named(draw(kind, np.random.default_rng([seed, list(WORDS).index(kind), number])))
            cases += 1
            progress(cases, each * len(WORDS))
    return {"cases": cases, "named": count}


def named(case: Claimed) -> bool:
    """Whether a wrong controller is named for its fault and for nothing else, and a right one not."""
    finding = case.finding
    if case.kind == "right":
        return finding.severity is Severity.INFO
    others = {words for words in WORDS.values() if words and words != WORDS[case.kind]}
    text = finding.what
    return (
        finding.severity is Severity.WARNING and WORDS[case.kind] in text and not any(word in text for word in others)
    )


def draw(kind: str, random: np.random.Generator) -> Claimed:
    """A case of a kind."""
    axes = int(random.integers(2, 5)) if kind == "swapped axes" else int(random.integers(1, 5))
    record, loop = draw_record(random, axes=axes)
    controller: KnownController = loop.controller
    if kind in OF_LINEAR_LAWS and random.random() < 0.33:
        limit = LinearControllerParameters(current_limit=controller.current_limit)
        controller = LinearControl(pd_as_linear(loop.controller, axes), limit)
    if kind in OTHER_RECORDS:
        record = OTHER_RECORDS[kind](record, random)
    elif kind in OTHER_CONTROLLERS:
        controller = OTHER_CONTROLLERS[kind](loop.controller, random)
    if kind == "sample time":
        controller = loop.controller.at_rate(1.0 / record.sample_time)
    return Claimed(kind, _with_digits(record) if random.random() < 0.5 else record, controller)


def _some_reversed(record: LoopRecord, random: np.random.Generator) -> LoopRecord:
    sign = np.where(random.random(len(record.axes)) < 0.5, -1.0, 1.0)
    sign[random.integers(len(sign))] = -1.0
    return replace(record, current=record.current * sign)


def _shifted(record: LoopRecord, shift: int) -> LoopRecord:
    current = np.roll(record.current, shift, axis=0)
    return replace(record, current=current).window(record.first_step + 2, record.steps - 4)


OTHER_RECORDS: dict[str, Callable[[LoopRecord, np.random.Generator], LoopRecord]] = {
    "all gains": lambda record, random: replace(record, current=record.current * random.choice([0.9, 1.1, 1000.0])),
    "sign": _some_reversed,
    "swapped axes": lambda record, random: replace(record, current=np.roll(record.current, 1, axis=1)),
    "currents later": lambda record, random: _shifted(record, int(random.choice([1, 1, 2]))),
    "currents earlier": lambda record, random: _shifted(record, -int(random.choice([1, 1, 2]))),
    "sample time": lambda record, random: replace(record, sample_time=record.sample_time * random.choice([0.5, 2.0])),
    "constant": lambda record, random: replace(
        record, current=record.current + random.uniform(0.3, 2.0) * record.current.std(axis=0)
    ),
}


def _changed(controller: ControllerParameters, name: str, factor: float) -> ControllerParameters:
    return controller.model_copy(update={name: tuple(factor * gain for gain in getattr(controller, name))})


def _on_the_other(controller: ControllerParameters) -> ControllerParameters:
    other = "measurement" if controller.derivative_on == "error" else "error"
    return controller.model_copy(update={"derivative_on": other})


def _filtered(controller: ControllerParameters) -> ControllerParameters:
    time = 2.5e-4 if controller.derivative_filter == 0.0 else 0.4 * controller.derivative_filter
    return controller.model_copy(update={"derivative_filter": time})


OTHER_CONTROLLERS: dict[str, Callable[[ControllerParameters, np.random.Generator], ControllerParameters]] = {
    "proportional gain": lambda law, random: _changed(law, "proportional_gains", float(random.choice([0.9, 1.1]))),
    "derivative gain": lambda law, random: _changed(law, "derivative_gains", float(random.choice([0.9, 1.1]))),
    "derivative": lambda law, random: _on_the_other(law),
    "filter": lambda law, random: _filtered(law),
}


def _with_digits(record: LoopRecord) -> LoopRecord:
    """As a text file keeps it: six digits."""
    signals = {}
    for name in ("reference", "position", "current"):
        values = getattr(record, name)
        step = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-12))) - 5.0)
        signals[name] = np.round(values / step) * step
    return replace(record, **signals)


if __name__ == "__main__":
    start_alone(run)
