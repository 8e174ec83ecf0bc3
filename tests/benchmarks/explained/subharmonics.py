"""What the three tones of the subharmonic test make in the paper's bearing, in variants of it and in the rig.

Amplitudes are in micrometres. A figure is None where there is no steady state, or no such line or tone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from amb_core.ground.units import UM
from amb_core.regions.subharmonics import VARIANTS, SubharmonicSettings
from tests.benchmarks.explained.subharmonics_cases import LOOPS, Case, Loop, Response, Tables, respond
from tests.benchmarks.regions.spread import spread
from tests.front_door.figures import Figures

AMPLITUDES = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0)  # um
RIG_AMPLITUDES = (5.0, 10.0, 20.0, 40.0)  # um; a run of the rig takes five times as long
PHASES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # rad
OFFSETS = (1.0, 3.0, 5.0, 7.0, 10.0, 100.0)  # Hz
SURFACE_AMPLITUDES = tuple(5.0 * index for index in range(1, 11))  # um
SURFACE_FREQUENCIES = tuple(250.0 * index for index in range(2, 19))  # Hz
CLOCK_BLOCKS = 5  # blocks of the test hold one period of the smallest offset

SMALLEST: dict[str, Any] = {
    "settings": SubharmonicSettings(
        block_duration=0.02, offset_1=50.0, offset_2=50.0, offset_3=350.0, order=3, rest=0.01, fade_in=0.01,
        agreeing_blocks=2, longest_run=0.04, line_tolerance=1e-3, bias_tolerance=1e-3,
    ),
    "amplitudes": (5.0,),
    "rig_amplitudes": (5.0,),
    "phases": (0.0,),
    "offsets": (350.0,),
    "surface": ((5.0,), (2500.0,)),
}  # fmt: skip


class Largest(Figures):
    """Amplitudes of the inducing tone.

    Attributes
    ----------
    held : float or None
        The largest up to which all amplitudes hold the rotor.
    lost : float or None
        The smallest that does not.
    held_again : list of float
        Larger ones that do.
    """

    held: float | None
    lost: float | None
    held_again: list[float]


class Held(Figures):
    """Inducing tones that hold the rotor, as requested and with all tones shifted."""

    requested: Largest
    shifted: Largest


class HeldByLoop(Figures):
    """By loop, see `LOOPS`."""

    given: Held
    limit_10: Held
    differential: Held
    differential_limit_10: Held
    top_coil: Held
    no_gravity: Held
    on_measurement: Held
    rig: Held
    rig_limit_10: Held
    rig_low: Held
    rig_low_limit_10: Held


class Phases(Figures):
    """By phase of the inducing tone of the test, with a control current limit of 10 A."""

    phase_rad: list[float]
    difference: list[float | None]
    bias: list[float | None]


class Component(Figures):
    """f1, f2 and f2 - f1 as requested; f2 - f1 and 2 f1 - f2 with shifted tones."""

    first: float | None
    second: float | None
    difference: float | None
    shifted_difference: float | None
    shifted_third_order: float | None


class Components(Figures):
    """By loop and amplitude of the inducing tone; in one test it is not shifted."""

    given_0: Component
    given_2_5: Component
    given_5: Component
    limit_10_5: Component
    limit_10_40: Component
    limit_10_40_not_shifted: Component
    rig_0: Component
    rig_5: Component
    rig_limit_10_40: Component
    rig_low_0: Component
    rig_low_5: Component
    rig_low_limit_10_40: Component


class Cause(Figures):
    """f2 - f1 by two tones alone, and with an inducing tone of 5 um."""

    alone: float | None
    alone_shifted: float | None
    induced: float | None
    induced_shifted: float | None


class Slow(Figures):
    """Root mean squares in the band of slow components, see `Response`."""

    band: float | None
    folded: float | None
    unfolded: float | None
    rest: float | None


class SlowByTest(Figures):
    """By loop and amplitude of the inducing tone, with tones as requested or shifted."""

    given_5: Slow
    given_2_5_shifted: Slow
    given_5_shifted: Slow
    limit_10_40: Slow
    limit_10_2_5_shifted: Slow
    limit_10_5_shifted: Slow
    limit_10_15_shifted: Slow


class Offsets(Figures):
    """The line 10 f3 - 3 f_s, of an inducing tone of 5 um with a control current limit of 10 A."""

    offset_hz: list[float]
    line_hz: list[float | None]
    line: list[float | None]


class Surface(Figures):
    """Runs by state; of the steady ones the range of f2 - f1, and the largest slow component with its tone."""

    runs: int
    steady: int
    delevitated: int
    difference_low: float | None
    difference_high: float | None
    slow: float | None
    slow_hz: float | None
    inducing: float | None
    inducing_hz: float | None


class Subharmonics(Figures):
    """All of it; causes by the name of the variant."""

    held: HeldByLoop
    phases: Phases
    components: Components
    causes: dict[str, Cause]
    slow: SlowByTest
    offsets: Offsets
    surface: Surface
    surface_shifted: Surface


def measure(
    settings: SubharmonicSettings | None = None,
    amplitudes: Sequence[float] = AMPLITUDES,
    rig_amplitudes: Sequence[float] = RIG_AMPLITUDES,
    phases: Sequence[float] = PHASES,
    offsets: Sequence[float] = OFFSETS,
    surface: tuple[Sequence[float], Sequence[float]] = (SURFACE_AMPLITUDES, SURFACE_FREQUENCIES),
) -> dict[str, object]:
    """Figures of all tables; a test that several tables need is run once."""
    settings = settings or SubharmonicSettings()
    offsets = [1.0 / (CLOCK_BLOCKS * settings.block_duration), *offsets]
    tables = _tables(settings, amplitudes, rig_amplitudes, phases, offsets)
    tables["surface"] = _surface_cases(settings, *surface)
    cases = list(dict.fromkeys(case for rows in tables.values() for row in rows.values() for case in row))
    found = dict(zip(cases, spread(respond, cases), strict=True))
    rows = {
        table: {name: [found[case] for case in row] for name, row in named.items()} for table, named in tables.items()
    }
    phased, offset = rows["phases"]["all"], rows["offsets"]["all"]
    return {
        "held": {name: _held(tables["held"][name], row) for name, row in rows["held"].items()},
        "phases": {
            "phase_rad": list(phases),
            "difference": [response.difference for response in phased],
            "bias": [response.bias for response in phased],
        },
        "components": {name: _component(*row) for name, row in rows["components"].items()},
        "causes": {
            name: dict(zip(Cause.model_fields, (response.difference for response in row), strict=True))
            for name, row in rows["causes"].items()
        },
        "slow": {name: {key: getattr(row[0], key) for key in Slow.model_fields} for name, row in rows["slow"].items()},
        "offsets": {
            "offset_hz": offsets,
            "line_hz": [response.tenth_hz for response in offset],
            "line": [response.tenth for response in offset],
        },
        "surface": _surface(tables["surface"]["requested"], rows["surface"]["requested"]),
        "surface_shifted": _surface(tables["surface"]["shifted"], rows["surface"]["shifted"]),
    }


def _tables(
    settings: SubharmonicSettings,
    amplitudes: Sequence[float],
    rig_amplitudes: Sequence[float],
    phases: Sequence[float],
    offsets: Sequence[float],
) -> Tables:
    """Cases of the rows of all tables."""
    limited = LOOPS["limit_10"]
    paper, small = _induced(settings, 40.0), _induced(settings, 5.0)

    def both(loop: Loop, amplitude: float) -> list[Case]:
        test = _induced(settings, amplitude)
        return [Case(loop, test), Case(loop, test.shifted())]

    components = {
        f"{name}_{amplitude:g}".replace(".", "_"): both(LOOPS[name], amplitude)
        for name, amplitude in (
            ("given", 0.0), ("given", 2.5), ("given", 5.0), ("limit_10", 5.0), ("limit_10", 40.0),
            ("rig", 0.0), ("rig", 5.0), ("rig_limit_10", 40.0),
            ("rig_low", 0.0), ("rig_low", 5.0), ("rig_low_limit_10", 40.0),
        )
    }  # fmt: skip
    not_shifted = Case(limited, paper.changed(offset_3=0.0).shifted())
    slow = {
        "given_5": both(LOOPS["given"], 5.0)[:1],
        "given_2_5_shifted": both(LOOPS["given"], 2.5)[1:],
        "given_5_shifted": both(LOOPS["given"], 5.0)[1:],
        "limit_10_40": both(limited, 40.0)[:1],
        "limit_10_2_5_shifted": both(limited, 2.5)[1:],
        "limit_10_5_shifted": both(limited, 5.0)[1:],
        "limit_10_15_shifted": both(limited, 15.0)[1:],
    }
    return {
        "held": {
            name: [case for amplitude in (rig_amplitudes if loop.rig else amplitudes) for case in both(loop, amplitude)]
            for name, loop in LOOPS.items()
        },
        "phases": {"all": [Case(limited, paper.changed(inducing_phase=phase)) for phase in phases]},
        "components": components | {"limit_10_40_not_shifted": [Case(limited, paper), not_shifted]},
        "causes": {
            variant.name: [case for a in (0.0, 5.0) for case in both(Loop(tuple(variant.values.items())), a)]
            for variant in VARIANTS
        },
        "slow": slow,
        "offsets": {"all": [Case(limited, _offset(small, offset)) for offset in offsets]},
    }


def _induced(settings: SubharmonicSettings, amplitude: float) -> SubharmonicSettings:
    return settings.changed(inducing_amplitude=amplitude / UM)


def _offset(settings: SubharmonicSettings, offset: float) -> SubharmonicSettings:
    """The shifted test with another shift of the inducing tone, in longer blocks where it needs them."""
    if offset * settings.block_duration < 1.0:
        times = {name: CLOCK_BLOCKS * getattr(settings, name) for name in ("block_duration", "longest_run")}
        settings = settings.changed(**times)
    return settings.changed(offset_3=offset).shifted()


def _surface_cases(
    settings: SubharmonicSettings, amplitudes: Sequence[float], frequencies: Sequence[float]
) -> dict[str, list[Case]]:
    limited = LOOPS["limit_10"]
    tests = [_induced(settings, a).changed(inducing_frequency=f) for a in amplitudes for f in frequencies]
    return {
        "requested": [Case(limited, test) for test in tests],
        "shifted": [Case(limited, test.shifted()) for test in tests],
    }


def _held(cases: list[Case], responses: list[Response]) -> dict[str, object]:
    amplitudes = [round(UM * case.test.inducing_amplitude, 3) for case in cases[::2]]
    fell = [response.delevitated for response in responses]
    return {"requested": _largest(amplitudes, fell[::2]), "shifted": _largest(amplitudes, fell[1::2])}


def _largest(amplitudes: list[float], fell: list[bool]) -> dict[str, object]:
    first = [*fell, True].index(True)
    again = [amplitude for amplitude, lost in zip(amplitudes[first:], fell[first:], strict=True) if not lost]
    return {
        "held": amplitudes[first - 1] if first else None,
        "lost": amplitudes[first] if first < len(amplitudes) else None,
        "held_again": again,
    }


def _component(requested: Response, shifted: Response) -> dict[str, object]:
    return {
        "first": requested.first,
        "second": requested.second,
        "difference": requested.difference,
        "shifted_difference": shifted.difference,
        "shifted_third_order": shifted.third_order,
    }


def _surface(cases: list[Case], responses: list[Response]) -> dict[str, object]:
    steady = [(found, case.test) for found, case in zip(responses, cases, strict=True) if found.slow is not None]
    differences = [found.difference for found, _ in steady if found.difference is not None]
    largest, test = max(steady, key=lambda item: item[0].slow or 0.0, default=(None, None))
    return {
        "runs": len(cases),
        "steady": len(steady),
        "delevitated": sum(found.delevitated for found in responses),
        "difference_low": min(differences, default=None),
        "difference_high": max(differences, default=None),
        "slow": largest and largest.slow,
        "slow_hz": largest and largest.slow_hz,
        "inducing": test and round(UM * test.inducing_amplitude, 3),
        "inducing_hz": test and test.inducing_frequency,
    }
