"""Commissioning of rigs with planted faults, and of healthy ones: what is named, in lock-step with the emulated plant.

A touch is a step in which the rotor is on its backup bearing, does not leave it, and the control currents push it
outwards with more than a fifth of the pull of one magnet at its bias current: by the true currents, position and
velocity. The pull of the bias alone is not counted: it flows as soon as the amplifiers are on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.rig.commissioning.bench import Bench
from amb_core.rig.commissioning.diagnosis import Diagnosis, diagnose
from amb_core.rig.commissioning.expected import expected_of
from amb_core.rig.commissioning.sensors_at_rest import PUSHES
from amb_core.rig.emulation import FaultParameters, LimitParameters, as_on_a_rig, reference_library
from amb_core.rig.emulation.lock_step import LockStepLink
from amb_core.rig.link.link import TargetSettings
from tests.kept_outcomes import KeptOutcomes, computing_code

TOUCH = 0.05
"""Control current outwards over bias current: the pull of one magnet at its bias is k_i i_0 / 4, a fifth of it 0.05."""
HAND = 4.0  # deg, standard deviation of the directions in which a hand pushes


@dataclass(frozen=True)
class Kind:
    """A kind of fault: what is planted, for the axes and with the generator of a rig, and the names that are right."""

    names: tuple[str, ...]
    planted: Callable[[Any], dict[str, Any]] = field(default=lambda rig: {})
    plant: Mapping[str, float] = field(default_factory=dict)  # of the true plant: factors, and values where it has 0
    of: str = "axis"  # or pair, across, below, machine


def _one(part: str, fault: str, **values: float) -> Callable[[Any], dict[str, Any]]:
    return lambda axes: {part: {fault: ", ".join(axes)} | values}


KINDS: dict[str, Kind] = {
    "no signal": Kind(("sensor silent",), _one("sensor", "failed")),
    "stuck sensor": Kind(("sensor dead",), _one("sensor", "stuck")),
    "noisy sensor": Kind(("sensor noise",), _one("sensor", "noisy", noise=5e-6)),
    "mains": Kind(("sensor hum",), _one("sensor", "humming", hum=4e-6)),
    "converter of 2 um": Kind(("sensor coarse",), _one("sensor", "coarse")),
    "sensor reversed": Kind(("sensor reversed",), _one("sensor", "inverted")),
    "both sensors reversed": Kind(("sensor reversed",), _one("sensor", "inverted"), of="pair"),
    "sensors swapped": Kind(("sensors swapped",), _one("sensor", "swapped"), of="pair"),
    "sensors swapped between bearings": Kind(("sensors swapped",), _one("sensor", "swapped"), of="across"),
    "sensors turned by 15 deg": Kind(("sensors turned",), _one("sensor", "turned"), of="pair"),
    "sensors turned by -30 deg": Kind(("sensors turned",), _one("sensor", "turned", angle=-30.0), of="pair"),
    "sensor of twice the gain": Kind(("sensor scale",), _one("sensor", "scaled")),
    "sensor of half the gain": Kind(("sensor scale",), _one("sensor", "scaled", scale=0.5)),
    "sensor with an offset": Kind(("sensor offset",), _one("sensor", "shifted")),
    "sensor ends at 100 um": Kind(("sensor clips",), _one("sensor", "clipped")),
    "sensor one sample late": Kind(("delay",), _one("sensor", "late")),
    "sensor two samples late": Kind(("delay",), _one("sensor", "late", late_steps=2.0)),
    "sensor five samples late": Kind(("delay",), _one("sensor", "late", late_steps=5.0)),
    "sensor of 300 Hz": Kind(("low-pass",), _one("sensor", "slow")),
    "sensor disturbed by amplifiers": Kind(("noise when on",), _one("sensor", "disturbed", noise=2e-6)),
    "coils reversed": Kind(("coils reversed",), _one("coil", "inverted")),
    "all coils of a bearing reversed": Kind(("coils reversed",), _one("coil", "inverted"), of="pair"),
    "coils swapped": Kind(("coils swapped",), _one("coil", "swapped"), of="pair"),
    "coils swapped between bearings": Kind(("coils swapped",), _one("coil", "swapped"), of="across"),
    "no control current": Kind(("coil dead",), _one("coil", "dead")),
    "magnets turned by 15 deg": Kind(("coils turned",), _one("coil", "turned"), of="pair"),
    "magnets turned by -30 deg": Kind(("coils turned",), _one("coil", "turned", angle=-30.0), of="pair"),
    "amplifier of twice the gain": Kind(("amplifier gain",), _one("coil", "scaled")),
    "amplifier of half the gain": Kind(("amplifier gain",), _one("coil", "scaled", scale=0.5)),
    "amplifier ends at 0.3 A": Kind(("too little force", "amplifier saturates"), _one("coil", "weak")),
    "current one sample late": Kind(("delay",), _one("coil", "late")),
    "current two samples late": Kind(("delay",), _one("coil", "late", late_steps=2.0)),
    "amplifier of 300 Hz": Kind(("low-pass",), _one("coil", "slow")),
    "load that the model lacks": Kind(("load",), plant={"rotor.external_force_y": 30.0}, of="below"),
    "sensor and coils reversed": Kind(
        ("sensor reversed", "coils reversed"),
        lambda axes: {part: {"inverted": ", ".join(axes)} for part in ("sensor", "coil")},
    ),
    "sensors and coils swapped": Kind(
        ("sensors swapped",), lambda axes: {part: {"swapped": ", ".join(axes)} for part in ("sensor", "coil")},
        of="pair",
    ),
    "lighter rotor": Kind(("mass",), plant={"rotor.mass": 0.65, "rigid_rotor.mass": 0.65,
                                            "rigid_rotor.transverse_inertia": 0.65}, of="machine"),
    "less bias": Kind(("bias or stiffness", "too little force"), plant={"amplifier.bias_current": 0.7}, of="machine"),
    "amplifiers report a fault": Kind(("target trips",), lambda axes: {"amplifier": True}, of="machine"),
    "too hot": Kind(("target trips",), lambda axes: {"temperature": 150.0}, of="machine"),
}  # fmt: skip


@dataclass(frozen=True)
class Rig:
    """A rig: its kind of fault (empty: none), axes and seed."""

    kind: str
    axes: int
    seed: int


@dataclass(frozen=True)
class Outcome:
    """What was said about a rig, and what happened to it."""

    rig: Rig
    planted: tuple[str, ...]
    said: tuple[str, ...]
    right: bool
    touches: int


def commission(rig: Rig) -> Outcome:
    """Draw the machine of a rig, plant its fault, and diagnose it."""
    generator = np.random.default_rng((rig.seed, rig.axes))
    model, true = _machines(rig, generator)
    kind = KINDS.get(rig.kind)
    axes = _axes_of_fault(kind, rig.axes, generator) if kind is not None else ()
    planted = kind.planted(axes) if kind is not None else {}
    faults = validate(FaultParameters, {"seed": rig.seed} | planted)
    controller = ControllerParameters()
    limits = validate(LimitParameters, {})
    counted = [0]
    link = LockStepLink(true, controller, limits, faults, reference_library(), lambda: _count(link, counted))
    settings = TargetSettings(
        controller, limits.with_current(controller.current_limit), (0.0, -180e-6) * (rig.axes // 2)
    )
    bench = Bench(link, lambda _: settings, lambda step: link.advance(max(step - link.steps, 0)))
    link.advance(50)
    diagnosis = diagnose(bench, expected_of(model, controller), lambda _: _by_hand(link, bench, generator))
    return Outcome(rig, axes, tuple(map(str, diagnosis.findings)), _right(diagnosis, kind, axes), counted[0])


def _machines(rig: Rig, generator: np.random.Generator) -> tuple[PlantParameters, PlantParameters]:
    """The machine as its parameter file has it, and as it is: with tolerances, and the fault of a machine."""
    drawn = {
        "rotor.mass": 6.25 * generator.uniform(0.8, 1.15),
        "amplifier.bias_current": 3.0 * generator.uniform(0.9, 1.1),
        "magnetic_circuit.air_gap": 0.6e-3 * generator.uniform(0.95, 1.1),
    }
    drawn["rigid_rotor.mass"] = 2.0 * drawn["rotor.mass"]
    drawn["rigid_rotor.transverse_inertia"] = 0.04 * drawn["rotor.mass"]
    if rig.axes == 4:
        drawn["rotor.model"] = "rigid"
    base = flatten(PlantParameters().model_dump())
    model = validate(PlantParameters, base | drawn)
    kind = KINDS.get(rig.kind)
    actual = {name: value * generator.uniform(0.97, 1.03) if name != "rotor.model" else value
              for name, value in drawn.items()}  # fmt: skip
    for name, factor in (kind.plant if kind is not None else {}).items():
        actual[name] = actual[name] * factor if name in actual else factor
    others = {
        "sensor.noise": 10.0 ** generator.uniform(-8.0, -7.0), "sensor.noise_seed": rig.seed,
        "backup_bearing.stiffness": 10.0 ** generator.uniform(7.0, 7.8),
        "backup_bearing.friction": generator.uniform(0.05, 0.25),
    }  # fmt: skip
    return model, as_on_a_rig(validate(PlantParameters, base | actual | others))


def _axes_of_fault(kind: Kind, axes: int, generator: np.random.Generator) -> tuple[str, ...]:
    names = ("x", "y") if axes == 2 else ("x_a", "y_a", "x_b", "y_b")
    if kind.of == "machine":
        return ()
    if kind.of == "across" and axes == 4:
        return names[::2] if generator.random() < 0.5 else names[1::2]
    if kind.of == "below":
        return (names[1],)
    if kind.of in ("pair", "across"):
        first = 2 * int(generator.integers(axes // 2))
        return names[first : first + 2]
    return (names[int(generator.integers(axes))],)


def _count(link: LockStepLink, counted: list[int]) -> None:
    """A touch, by true currents and positions."""
    if not link.plant.contact:
        return
    bias = link.plant.parameters.amplifier.bias_current
    coils = link.plant.coil_currents.reshape(-1, 4)
    control = 0.5 * (coils[:, :2] - coils[:, 2:])
    for current, position, velocity, touched in zip(control, *link.plant.journals(), strict=True):
        outwards = position / math.hypot(*position)
        counted[0] += bool(touched and velocity @ outwards >= 0.0 and current @ outwards > TOUCH * bias)


def _by_hand(
    link: LockStepLink, bench: Bench, generator: np.random.Generator
) -> dict[str, dict[str, NDArray[np.float64]]]:
    """A hand that pushes each journal to its backup bearing, roughly in four directions."""
    axes, radius = len(bench.machine.axes), link.plant.parameters.rotor.backup_bearing_radius
    pushed: dict[str, dict[str, NDArray[np.float64]]] = {}
    for number, bearing in enumerate(bench.machine.bearings):
        pushed[bearing.name] = {}
        for way, degrees in PUSHES.items():
            angle = math.radians(degrees + HAND * generator.standard_normal())
            place = np.tile([0.0, -0.98 * radius], axes // 2)
            place[2 * number : 2 * number + 2] = (
                radius * generator.uniform(0.95, 1.0) * np.array([math.cos(angle), math.sin(angle)])
            )
            link.hold(place)
            bench.record(0.01)
            pushed[bearing.name][way] = bench.record(0.06).position
    link.hold(None)
    return pushed


def _right(diagnosis: Diagnosis, kind: Kind | None, axes: tuple[str, ...]) -> bool:
    """Whether every name is right and all that was planted is named; nothing for a healthy rig."""
    if kind is None:
        return not diagnosis.findings
    named = {name for one in diagnosis.findings for name in one.axes}
    right = all(one.fault in kind.names for one in diagnosis.findings)
    return bool(diagnosis.findings) and right and (not axes or named == set(axes))


def _outcome(data: dict[str, Any]) -> Outcome:
    planted, said = tuple(data["planted"]), tuple(data["said"])
    return Outcome(Rig(**data["rig"]), planted, said, data["right"], data["touches"])


def rigs(kinds: int, each: int, healthy: int) -> list[Rig]:
    """So many of each of some kinds, spread over all, and healthy ones; half of them with four axes."""
    chosen = list(KINDS)[:: max(len(KINDS) // kinds, 1)][:kinds]
    faulty = [
        Rig(kind, 2 + 2 * (number % 2), 1000 * list(KINDS).index(kind) + number)
        for number in range(each)
        for kind in chosen
    ]
    sound = [Rig("", 2 + 2 * (number % 2), 100_000 + number) for number in range(healthy)]
    return sorted([*faulty, *sound], key=lambda rig: rig.seed % 1000)  # so that any part of them is of all kinds


def commissioning(
    kinds: int = len(KINDS),
    each: int = 6,
    healthy: int = 60,
    jobs: int = 2,
    file: Path | None = None,
    most: int | None = None,
) -> dict[str, Any]:
    """Figures of all rigs; what was wrong is printed.

    Parameters
    ----------
    kinds, each, healthy : int, optional
        Kinds of fault, rigs of each, and healthy ones.
    jobs : int, optional
        Processes.
    file : Path, optional
        Keeps the outcome of each rig, so that the next call with the same code goes on; None: none is kept.
    most : int, optional
        Rigs in this call; the figures are those of all that have been kept. None for all that are left.
    """
    reference_library()
    kept: KeptOutcomes[Outcome] = KeptOutcomes(file, computing_code(Path(__file__)), asdict, _outcome)
    wanted = rigs(kinds, each, healthy)
    known = {one.rig: one for one in kept.load()}
    left = [rig for rig in wanted if rig not in known]
    with ProcessPoolExecutor(jobs) as pool:
        for one in pool.map(commission, left[:most]):
            known[one.rig] = one
            kept.add(one)
    outcomes = [known[rig] for rig in wanted if rig in known]
    for one in outcomes:
        if not one.right or one.touches:
            outcome = f"{one.touches} touches, {one.said}"
            print(f"commissioning: {one.rig}, planted in {one.planted}: {outcome}", flush=True)
    return {
        "commissioning": {
            "rigs": len(outcomes),
            "right": sum(one.right for one in outcomes),
            "silent": sum(bool(one.rig.kind) and not one.said for one in outcomes),
            "accused": sum(not one.rig.kind and bool(one.said) for one in outcomes),
            "touches": sum(one.touches > 0 for one in outcomes),
        }
    }
