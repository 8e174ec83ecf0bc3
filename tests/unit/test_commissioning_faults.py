"""Faults of rigs are named before the first lift-off where physics allows, and no rotor is pressed onto its bearing.

The soak draws 300 rigs; here is one of each way in which a fault is found.
"""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.loop.linear_control import LinearController, LinearControllerParameters
from amb_core.loop.linear_parameters import with_anti_windup
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.rig.commissioning.finding import Finding
from amb_core.rig.commissioning.sensors_at_rest import hand_findings, noise_findings
from amb_core.rig.commissioning.tones import generator_of, response_to, tone_set
from tests.soak.commissioning import KINDS, Rig, commission

MACHINE = Plant(PlantParameters()).machine
RATE = 10_000.0


@pytest.mark.parametrize(
    ("kind", "axes"),
    [
        ("converter of 2 um", 2),
        ("sensors turned by 15 deg", 2),
        ("sensor and coils reversed", 2),
        ("coils swapped between bearings", 4),
        ("magnets turned by -30 deg", 2),
        ("amplifier of twice the gain", 2),
        ("sensor one sample late", 2),
        ("sensor disturbed by amplifiers", 2),
        ("amplifier ends at 0.3 A", 2),
    ],
)
def test_a_planted_fault_is_named_and_nothing_else_without_a_touch(kind: str, axes: int) -> None:
    outcome = commission(Rig(kind, axes, 1))
    assert outcome.right, outcome.said
    assert outcome.touches == 0


@pytest.mark.parametrize("axes", [2, 4])
def test_a_healthy_rig_is_not_accused(axes: int) -> None:
    outcome = commission(Rig("", axes, 2))
    assert (outcome.said, outcome.touches) == ((), 0)


def test_there_are_forty_kinds_of_fault() -> None:
    assert len(KINDS) == 40


# -- its parts


def test_a_controller_without_inputs_plays_its_tones_on_one_axis() -> None:
    tones = tone_set(50.0, 800.0, 6, 0.2)
    model = generator_of(tones, 1, 2, 0.05, RATE)
    law = LinearController(with_anti_windup(model), LinearControllerParameters(current_limit=0.06), 2, RATE)
    played = np.array([law.update([1e-4, -2e-4], [0.0, 0.0]) for _ in range(2_000)])
    assert played[:, 1] == pytest.approx(0.05 * tones.waveform(2_000, RATE), abs=2e-5)
    assert not played[:, 0].any()
    assert np.abs(played).max() <= 0.0501


def test_amplitudes_of_tones_are_found_beside_noise_and_drift() -> None:
    tones = tone_set(50.0, 800.0, 6, 0.2)
    draw = np.random.default_rng(1)
    current = np.column_stack([tones.waveform(2_000, RATE), np.zeros(2_000)])
    drift = 1e-6 * np.linspace(0.0, 1.0, 2_000) ** 2
    position = -3e-7 * current + drift[:, np.newaxis] + 1e-8 * draw.standard_normal((2_000, 2))
    response = response_to(tones, LoopRecord(0, 1.0 / RATE, np.zeros_like(position), position, current))
    ratio = response.position[:, 0] / response.current[:, 0]
    assert np.abs(ratio + 3e-7).max() < 5.0 * response.deviation[0] / np.abs(response.current[:, 0]).min()


def test_mains_and_noise_are_told_apart() -> None:
    time, draw = np.arange(3_000) / RATE, np.random.default_rng(1)
    quiet = 2e-8 * draw.standard_normal((3_000, 2))
    hum = quiet + np.column_stack([4e-6 * np.sin(2.0 * np.pi * 50.0 * time), 0.0 * time])
    noisy = quiet + [0.0, 5e-6] * draw.standard_normal((3_000, 2))
    names = [
        [(one.fault, one.axes) for one in noise_findings(values, ("x", "y"), 2e-6)] for values in (quiet, hum, noisy)
    ]
    assert names == [[], [("sensor hum", ("x",))], [("sensor noise", ("y",))]]


@pytest.mark.parametrize(
    ("matrix", "fault"),
    [
        ([[1.0, 0.0], [0.0, 1.0]], None),
        ([[-1.0, 0.0], [0.0, 1.0]], ("sensor reversed", ("x",))),
        ([[0.0, 1.0], [1.0, 0.0]], ("sensors swapped", ("x", "y"))),
        ([[1.0, 0.0], [0.0, 0.5]], ("sensor scale", ("y",))),
        ([[0.97, 0.26], [-0.26, 0.97]], ("sensors turned", ("x", "y"))),
        ([[0.0, 0.0], [0.0, 1.0]], ("sensor dead", ("x",))),
    ],
)
def test_a_rotor_moved_by_hand_shows_what_its_sensors_are(matrix: list, fault: tuple | None) -> None:
    draw = np.random.default_rng(1)
    ways = {"+x": [1.0, 0.0], "+y": [0.0, 1.0], "-x": [-1.0, 0.0], "-y": [0.0, -1.0]}
    pushed = {
        MACHINE.bearings[0].name: {
            way: 250e-6 * np.array(matrix) @ place + 1e-8 * draw.standard_normal((100, 2))
            for way, place in ways.items()
        }
    }
    findings: list[Finding] = hand_findings(pushed, MACHINE)
    assert [(one.fault, one.axes) for one in findings] == ([] if fault is None else [fault])
