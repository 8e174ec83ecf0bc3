"""Commissioning of a rig: what is measured is right, and wrong wiring, noise and calibration are named."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from typing import NoReturn

import numpy as np
import pytest

from amb_bringup.experiments.wiring import Wiring, require_rest
from amb_core.excitation import Square, generate
from amb_core.excitation.axes import parts_of
from amb_core.ground.errors import IdentificationError, TargetError
from amb_core.ground.parameters import validate
from amb_core.linear.model import StateSpaceModel
from amb_core.linear.simulation import simulate as respond
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.report.pages import write_report
from amb_core.report.pages.commissioning import protocol_report
from amb_core.rig import commissioning
from amb_core.rig.commissioning import (
    CommissioningSettings,
    Expected,
    Protocol,
    StaticResponse,
    Step,
    at_most,
    calibration_checks,
    closed_loop,
    expected_of,
    fade_checks,
    first_lift,
    fit_second_order,
    levitation_checks,
    measured,
    model_checks,
    rest_checks,
    runaway,
    static_response,
    sweep,
)
from amb_core.rig.commissioning.bench import LostSamplesError
from amb_core.rig.commissioning.tones import tone_set
from amb_core.rig.emulation import FaultParameters, LimitParameters, reference_library
from amb_core.rig.emulation.lock_step import LockStepLink
from amb_core.rig.link import AmbUdpLink, LevitatedError, RebootedError, TargetSettings, TargetState
from amb_sim_node.bridge_parameters import BridgeParameters
from tests.emulated_host import Bench
from tests.served_emulator import ServedEmulator
from tests.unit.test_target_link import PATIENT, Listener, levitated

SETTINGS = CommissioningSettings()
RATE = 10_000.0
MACHINE = Plant(PlantParameters()).machine


@pytest.fixture(scope="module")
def expected() -> Expected:
    return expected_of(PlantParameters(), ControllerParameters())


@pytest.mark.parametrize("model", ["point_mass", "rigid"])
def test_a_rotor_lies_where_weight_and_constant_force_press_it(model: str) -> None:
    """There the magnets pull more along the load, and hardly more across it."""
    for changes, of_a in (
        ({}, [1.0, 1.6]),
        ({"rotor.external_force_y": 100.0}, [1.0, 1.6]),  # above
        ({"rotor.gravity": 0.0, "rotor.external_force_x": -30.0}, [1.6, 1.0]),
    ):
        plant = validate(PlantParameters, {"rotor.model": model, **changes})
        assert expected_of(plant, ControllerParameters()).resting[:2] == pytest.approx(of_a, abs=0.06)
    weightless = validate(PlantParameters, {"rotor.model": model, "rotor.gravity": 0.0})
    assert expected_of(weightless, ControllerParameters()).resting == pytest.approx(1.0)


def failed(checks: list) -> list[str]:
    return [check.what for check in checks if check.passed is False]


def record_of(position: np.ndarray, reference: np.ndarray | None = None) -> LoopRecord:
    reference = np.zeros_like(position) if reference is None else reference
    return LoopRecord(0, 1.0 / RATE, reference, position, 1e3 * position)


# -- expectations and responses


def test_the_model_of_the_paper_bearing_is_expected_as_it_is_known(expected: Expected) -> None:
    """62.7 Hz and 0.492 on x; a gain above one, since the magnets pull the rotor on; 1.36 A against the weight."""
    resonance = fit_second_order(np.arange(6.0, 170.0, 0.5), expected.response(np.arange(6.0, 170.0, 0.5), 0))
    assert resonance.natural_hz == pytest.approx(62.7, abs=0.2)
    assert resonance.damping_ratio == pytest.approx(0.492, abs=0.005)
    assert np.diag(expected.gain) == pytest.approx([1.357, 1.389], abs=0.005)
    assert expected.current == pytest.approx([0.0, 1.363], abs=0.005)
    assert expected.unstable_poles == 2


def test_gains_at_rest_are_measured_from_steps_of_the_full_plant(expected: Expected) -> None:
    steps = Square(amplitude=5e-6, duration=1.0, frequency=4.0, axes="in_turn")
    signal = generate(steps, RATE, MACHINE)
    total = 2_000 + signal.steps + 500
    record = simulate(Plant(PlantParameters()), PdController(ControllerParameters()), total, signal.samples, 2_000)
    parts = [
        record.window(2_000 + part.first - 1, part.stop - part.first + 2) for part in parts_of("in_turn", signal.steps)
    ]
    response = static_response(parts)
    assert response.gain == pytest.approx(expected.gain, abs=0.01)
    law = 20_000.0 * (np.eye(2) - expected.gain)
    assert response.current == pytest.approx(law, abs=200.0)


def test_a_reference_that_does_not_step_determines_no_gain() -> None:
    with pytest.raises(IdentificationError, match="does not go up and down"):
        static_response([record_of(np.zeros((100, 1)))])


def test_the_resonance_is_that_of_the_loop_that_was_swept(expected: Expected) -> None:
    signal = sweep(SETTINGS)
    samples = generate(signal, RATE, MACHINE).samples[: round(5.0 * RATE)]
    reference = np.vstack([samples, np.zeros((3_000, 2))])
    position = respond(expected.loop, reference)
    response = closed_loop(record_of(position, reference), 0, (5.0, 200.0))
    truth = fit_second_order(response.frequency, expected.response(response.frequency, 0))
    assert response.resonance.natural_hz == pytest.approx(truth.natural_hz, rel=0.005)
    assert response.resonance.damping_ratio == pytest.approx(truth.damping_ratio, abs=0.005)


# -- the rotor at rest


def test_noise_missing_signals_and_impossible_places_of_sensors_are_found() -> None:
    draw = np.random.default_rng(1)
    quiet = 0.2e-6 * draw.standard_normal((50, 2)) + [0.0, -240e-6]
    assert failed(rest_checks(quiet, MACHINE, SETTINGS)) == []
    noisy = quiet + [5e-6, 0.0] * draw.standard_normal((50, 2))
    assert failed(rest_checks(noisy, MACHINE, SETTINGS)) == ["noise of x, rms"]
    lost = quiet.copy()
    lost[3, 1] = np.nan
    assert "signal of y" in failed(rest_checks(lost, MACHINE, SETTINGS))
    assert failed(rest_checks(quiet * 2.0, MACHINE, SETTINGS)) == ["resting place in bearing a over clearance"]


def test_a_levitation_is_timed_until_the_rotor_rests_and_its_orbit_and_currents_are_limited() -> None:
    time = np.arange(10_000) / RATE
    place = np.array([0.0, -68e-6])
    position = place * (1.0 - np.exp(-time[:, np.newaxis] / 0.01))
    record = LoopRecord(0, 1.0 / RATE, np.zeros_like(position), position, np.full_like(position, 1.4))
    checks = levitation_checks(record, MACHINE, np.array([3.0, 3.0]), SETTINGS)
    assert failed(checks) == []
    rest = next(check for check in checks if check.what.startswith("time until"))
    assert rest.value == pytest.approx(0.01 * np.log(68.0 / 5.0), abs=2e-4)
    circling = position + 20e-6 * np.column_stack([np.cos(400 * time), np.sin(400 * time)])
    worse = LoopRecord(0, 1.0 / RATE, np.zeros_like(position), circling, np.full_like(position, 2.9))
    assert failed(levitation_checks(worse, MACHINE, np.array([3.0, 3.0]), SETTINGS)) == [
        "orbit in bearing a over clearance",
        "largest control current of x over its limit",
        "largest control current of y over its limit",
    ]


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ({"inverted": "y"}, "y ran upwards, so it was not the weight; its sensor or its coils have the wrong sign"),
        ({"swapped": "x, y"}, "x and y ran away together: sensors or coils swapped between them"),
    ],
)
def test_wrong_wiring_is_recognised_by_how_the_emulated_rotor_runs_away(fault: dict[str, str], text: str) -> None:
    with Bench(sensor=fault) as bench:
        bench.connect()
        bench.levitate(options=5)
        bench.run(400)
        blocks = bench.blocks()
    status = np.concatenate([block.status for block in blocks if block.status is not None]) & 0b111
    moving = (status >= 1) & (status <= 3)
    position, reference, current = (
        np.concatenate([getattr(block, name) for block in blocks])[moving]
        for name in ("position", "reference", "current")
    )
    assert text in runaway(LoopRecord(0, 1.0 / RATE, reference, position, current), MACHINE)


# -- verdicts


def calibrated(gain: np.ndarray, current: list[float], expected: Expected | None) -> list[str]:
    response = StaticResponse(gain, np.zeros_like(gain))
    return failed(calibration_checks(response, np.array(current), MACHINE, SETTINGS, expected))


def test_wrong_polarity_scale_cabling_and_load_fail_the_calibration(expected: Expected) -> None:
    right, current = expected.gain, [0.0, 1.36]
    assert calibrated(right, current, expected) == []
    assert calibrated(right, current, None) == []
    assert calibrated(right * [[1.5], [1.0]], current, expected) == ["position over reference of x"]
    assert calibrated(-right, current, None) == ["position over reference of x", "position over reference of y"]
    assert calibrated(right + np.array([[0.0, 0.5], [0.0, 0.0]]), current, expected) == ["motion of x with y"]
    for model in (expected, None):  # sensor and coils both reversed: the loop levitates
        assert calibrated(right, [0.0, -1.36], model) == ["control current at rest of y"]


def model_with(fit: float) -> StateSpaceModel:
    return StateSpaceModel(
        a=np.diag([1.1, 0.9]), b=np.eye(2), c=np.eye(2), d=np.zeros((2, 2)), k=np.zeros((2, 2)),
        innovation_covariance=np.eye(2), input_offset=np.zeros(2), output_offset=np.zeros(2), initial_state=np.zeros(2),
        sample_time=1e-4, input_names=("i_x", "i_y"), output_names=("x", "y"), fit=np.array([fit, fit]),
    )  # fmt: skip


def test_noise_of_the_loop_is_no_fault_of_the_model() -> None:
    draw = np.random.default_rng(2)
    rest = record_of(1e-7 * draw.standard_normal((3_000, 2)))
    excited = record_of(2e-7 * draw.standard_normal((3_000, 2)))
    unexplained = "motion of x not explained, noise apart"
    assert unexplained not in failed(model_checks(model_with(50.0), excited, rest, SETTINGS, None))
    assert unexplained in failed(model_checks(model_with(30.0), excited, rest, SETTINGS, None))
    still = record_of(np.zeros((3_000, 2)))
    assert unexplained in failed(model_checks(model_with(50.0), excited, still, SETTINGS, None))


def test_the_number_of_unstable_poles_is_that_of_the_model(expected: Expected) -> None:
    still = record_of(np.random.default_rng(3).standard_normal((100, 2)))
    checks = model_checks(model_with(99.0), still, record_of(np.zeros((100, 2))), SETTINGS, expected)
    assert failed(checks) == ["unstable poles of the plant"]


def test_an_excitation_that_goes_on_after_the_stop_fails() -> None:
    reference = np.zeros((20_000, 1))
    reference[:5_100] = 1e-6
    assert failed(fade_checks(reference, 5_000, 1e-4, SETTINGS)) == []
    reference[:15_000] = 1e-6
    assert len(failed(fade_checks(reference, 5_000, 1e-4, SETTINGS))) == 1


# -- the first steps, and who else commands the target


@pytest.fixture
def served() -> Iterator[ServedEmulator]:
    with ServedEmulator() as emulator:
        yield emulator


@pytest.fixture
def other(served: ServedEmulator) -> Iterator[AmbUdpLink]:
    """Another host, which is not connected yet."""
    link = AmbUdpLink(port=served.port, **PATIENT)
    yield link
    link.close()


def wired(served: ServedEmulator, settings: CommissioningSettings = SETTINGS, **link: float) -> Wiring:
    patient = {"timeout": 60.0, "silence": 60.0}
    values = {"link.port": served.port, "landing_time": 0.1, "levitation_time": 0.1}
    values |= {f"link.{name}": value for name, value in (patient | link).items()}
    return Wiring(validate(BridgeParameters, values), settings, None, None, lambda: None)


def test_a_rotor_that_another_host_levitates_is_refused_and_left_as_it_is(
    served: ServedEmulator, other: AmbUdpLink
) -> None:
    listener = Listener()
    levitated(other, listener)
    with pytest.raises(LevitatedError, match="levitated already; land it first"):
        wired(served)
    step = other.status().step
    listener.wait_for_step(step + 2_000)
    assert other.status().state is TargetState.LEVITATED
    assert other.count.samples.lost == 0, "its telemetry was taken away"


def test_so_it_is_without_the_first_steps(served: ServedEmulator, other: AmbUdpLink) -> None:
    listener, quiet = Listener(), {"link.port": served.port, "link.timeout": 60.0, "link.silence": 60.0}
    bridge = validate(BridgeParameters, quiet)
    require_rest(bridge, lambda: None)
    levitated(other, listener)
    with pytest.raises(LevitatedError, match="levitated already; land it first"):
        require_rest(bridge, lambda: None)
    listener.wait_for_step(other.status().step + 2_000)
    assert other.status().state is TargetState.LEVITATED
    assert other.count.samples.lost == 0, "its telemetry was taken away"


class OtherwiseLanded(LockStepLink):
    """Notes how long the landings that it is asked for take; may refuse slow ones."""

    def __init__(self, refuses: bool = False) -> None:
        limits = validate(LimitParameters, {})
        super().__init__(PlantParameters(), ControllerParameters(), limits, FaultParameters(), reference_library())
        self.landings: list[float] = []
        self._refuses = refuses

    def land(self, seconds: float) -> None:
        self.landings.append(seconds)
        if self._refuses and seconds > 0.0:
            raise TargetError("LAND was refused")
        super().land(seconds)


def bench_behind(link: LockStepLink, **limits: float) -> commissioning.Bench:
    settings = TargetSettings(ControllerParameters(), validate(LimitParameters, limits).with_current(3.0), ())
    rig = commissioning.Bench(link, lambda _: settings, lambda step: link.advance(max(step - link.steps, 0)))
    link.advance(50)
    return rig


def test_one_that_another_host_levitates_meanwhile_is_not_touched_either() -> None:
    link = OtherwiseLanded()
    rig = bench_behind(link)
    link.levitate(0.01)  # as another host does
    with pytest.raises(LevitatedError):
        rig.tones_at_rest(tone_set(50.0, 800.0, 6, 0.2), 0, 0.1, 0.2)
    with pytest.raises(LevitatedError):
        rig.levitate(0.01, 0.1)
    rig.off()
    rig.land(0.1)
    rig.down(0.1)
    link.advance(1_000)
    assert link.status().state is TargetState.LEVITATED


@pytest.mark.parametrize("problem", [LostSamplesError("telemetry was lost"), TargetError("UPLOAD was refused")])
def test_a_first_lift_that_cannot_go_on_lands_the_rotor(
    problem: TargetError, expected: Expected, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = OtherwiseLanded()
    rig = bench_behind(link)

    def excite(_samples: np.ndarray) -> NoReturn:
        assert rig.levitated
        raise problem

    monkeypatch.setattr(rig, "excite", excite)
    with pytest.raises(type(problem), match=str(problem)):
        first_lift.levitated(rig, expected, 0.2, moved=False)
    assert link.landings == [0.2], "it fell"
    assert link.status().state is TargetState.OFF


def test_a_loop_that_is_not_levitated_any_more_when_it_is_excited_is_unstable(
    expected: Expected, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = OtherwiseLanded()
    rig = bench_behind(link)

    def excite(_samples: np.ndarray) -> NoReturn:
        link.land(0.0)  # as a trip does
        raise TargetError("ARM was refused")

    monkeypatch.setattr(rig, "excite", excite)
    assert [one.fault for one in first_lift.levitated(rig, expected, 0.2, moved=False)] == ["unstable loop"]


def test_settings_that_are_refused_before_the_first_lift_are_no_trip(
    expected: Expected, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = OtherwiseLanded()
    rig = bench_behind(link)

    def refuse(_settings: TargetSettings) -> NoReturn:
        raise TargetError("PARAMETERS were refused")

    monkeypatch.setattr(link, "configure", refuse)
    with pytest.raises(TargetError, match="PARAMETERS were refused"):
        first_lift.levitated(rig, expected, 0.2, moved=False)


@pytest.mark.parametrize(
    ("limits", "unchecked"),
    [
        (
            {"excitation_amplitude": 5e-6},
            ["whether the amplifier of x saturates", "whether the amplifier of y saturates"],
        ),
        ({"excitation_slew": 0.01}, ["whether the amplifier of x saturates", "whether the amplifier of y saturates"]),
        ({"excitation_amplitude": 1e-6}, ["gains, delays and angles of the levitated rotor"]),
    ],
)
def test_what_the_excitation_limits_of_a_healthy_rig_do_not_allow_is_not_checked(
    limits: dict[str, float], unchecked: list[str], expected: Expected
) -> None:
    link, left_out = OtherwiseLanded(), list[str]()
    assert first_lift.levitated(bench_behind(link, **limits), expected, 0.2, False, left_out) == []
    assert [text.split(":")[0] for text in left_out] == unchecked
    assert link.landings == [0.2]


def test_a_rotor_that_the_target_does_not_land_is_switched_off() -> None:
    link = OtherwiseLanded(refuses=True)
    rig = bench_behind(link)
    rig.levitate(0.1, 0.1)
    rig.down(0.2)
    assert link.landings == [0.2, 0.0]
    link.advance(10)
    assert link.status().state is TargetState.OFF


def noisy(served: ServedEmulator, settings: CommissioningSettings) -> list[str]:
    """Findings on a rig whose sensor x has a noise of 3 um."""
    served.fail(sensor={"noisy": "x", "noise": 3e-6})
    wiring = wired(served, settings)
    try:
        return failed(wiring.before_lift())
    finally:
        wiring.close()


def test_the_limit_of_noise_that_is_given_holds_before_the_first_lift_too(served: ServedEmulator) -> None:
    assert "sensor noise of x" in noisy(served, SETTINGS)
    assert "sensor noise of x" not in noisy(served, CommissioningSettings(noise=5e-6))


def test_what_it_has_levitated_itself_is_landed_at_its_end(served: ServedEmulator, other: AmbUdpLink) -> None:
    wiring = wired(served)
    wiring.bench.levitate(0.01, 0.0)
    assert wiring.close() == ""
    other.connect(Listener())
    assert other.status().state is TargetState.OFF


def test_whether_currents_flow_is_not_known_after_the_link_was_lost(served: ServedEmulator) -> None:
    wiring = wired(served, timeout=2.0, silence=0.5)
    wiring.bench.levitate(0.01, 0.0)
    served.pause(True)
    assert "no reply from the target" in wiring.close()


def test_a_reboot_of_the_target_ends_the_wait_for_its_samples(served: ServedEmulator) -> None:
    wiring = wired(served)
    later = wiring.bench.status().step + 3_000

    def reboot() -> None:
        while served.do(lambda emulator: emulator.steps) < later:
            pass
        served.do(lambda emulator: emulator.reboot())

    rebooting = threading.Thread(target=reboot)
    rebooting.start()
    try:
        with pytest.raises(RebootedError, match="the target has rebooted"):
            wiring.bench.record(1e3)
    finally:
        rebooting.join()
        assert "rebooted" in wiring.close()


# -- protocol


def test_a_protocol_has_every_number_with_its_limit_and_fails_with_one_step(tmp_path) -> None:
    steps = [
        Step(
            "first",
            "First",
            "2026-01-01T00:00:00+00:00",
            1.0,
            [at_most("noise", 1.0, 2.0, "um"), measured("text", "a")],
        ),
        Step(
            "second", "Second", "2026-01-01T00:00:01+00:00", 1.0, [at_most("drift", float("nan"), 2.0, "ppm", "wait")]
        ),
        Step("third", "Third", skipped="second has failed"),
        Step("fourth", "Fourth", "2026-01-01T00:00:02+00:00", 1.0, problem="no answer"),
    ]
    protocol = Protocol({"machine": "one"}, steps)
    content = json.loads(json.dumps(protocol.to_json(), allow_nan=False))
    assert [step["result"] for step in content["steps"]] == ["passed", "failed", "skipped", "failed"]
    assert content["result"] == "failed"
    assert content["steps"][1]["checks"][0] == {
        "what": "drift", "value": None, "unit": "ppm", "limit": "at most 2 ppm", "passed": False, "advice": "wait",
    }  # fmt: skip
    assert content["steps"][2]["reason"] == "second has failed"
    write_report(protocol_report(protocol, []), tmp_path / "protocol.html")
    page = (tmp_path / "protocol.html").read_text()
    assert "Failed: second, fourth. Skipped: third." in page
    assert "at most 2 um" in re.sub("<[^>]*>", "", page)
