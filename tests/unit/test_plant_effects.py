"""What each effect of the plant does, against closed forms, and that it does nothing while it is off."""

import itertools

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
    RotorParameters,
    Trace,
    linearize,
)
from amb_core.plant.closed_forms import current_gain, force_constant, negative_stiffness
from amb_core.plant.iron import saturation_curve
from amb_core.plant.parameters import (
    BackupBearingParameters,
    ConverterParameters,
    IronParameters,
    SensorParameters,
)
from amb_core.plant.simulation import simulate

MASS, GRAVITY = 6.25, 9.81
TWO_PI = 2.0 * np.pi
IDEAL = MagneticCircuitParameters(relative_permeability=1e12)
HELD = RotorParameters(mass=1e5, gravity=0.0)
WITHOUT_FORCE = AmplifierParameters(bias_current=0.0)
SATURATING = IronParameters(saturation=True)


def levitate(plant: Plant, samples: int) -> list[Trace]:
    controller = PdController(ControllerParameters())
    return [plant.trace(controller.update(plant.position, (0.0, 0.0))) for _ in range(samples)]


def joined(traces: list[Trace], name: str) -> np.ndarray:
    return np.concatenate([getattr(trace, name) for trace in traces])


# -- off means off


@pytest.fixture(scope="module")
def paper():
    return run_paper(PlantParameters())


def run_paper(parameters: PlantParameters):
    return simulate(Plant(parameters), PdController(ControllerParameters()), 150, np.full((100, 2), 20e-6), 50)


@pytest.mark.parametrize(
    "off",
    [
        {"iron": IronParameters(pinning_field=10.0, journal_conductivity=1e7)},
        {"amplifier": AmplifierParameters(carriers="synchronous", dead_time=0.0)},
        {"rotor": RotorParameters(external_force_frequency=50.0)},
        {"rotor": RotorParameters(unbalance=1e-3)},
        {"rotor": RotorParameters(running_speed=200.0)},
        {"backup_bearing": BackupBearingParameters(stiffness=1e6, friction=0.5)},
        {"backup_bearing": BackupBearingParameters(contact=True)},
        {"sensor": SensorParameters(noise_seed=5)},
    ],
    ids=lambda off: next(iter(off)),
)
def test_an_effect_that_is_off_or_idle_leaves_the_samples_as_they_are(paper, off):
    assert run_paper(PlantParameters(**off)).identical_to(paper)


@pytest.mark.parametrize(
    "on",
    [
        {"iron": SATURATING},
        {"iron": IronParameters(saturation=True, hysteresis=True)},
        {"iron": IronParameters(solid_journal=True)},
        {"amplifier": AmplifierParameters(carriers="interleaved")},
        {"amplifier": AmplifierParameters(dead_time=1e-6)},
        {"rotor": RotorParameters(external_force_x=1.0)},
        {"rotor": RotorParameters(unbalance=1e-4, running_speed=50.0)},
        {"sensor": SensorParameters(bandwidth=5e3)},
        {"sensor": SensorParameters(noise=1e-9)},
        {"converters": ConverterParameters(position_resolution=1e-8)},
        {"converters": ConverterParameters(current_resolution=1e-3)},
        {"converters": ConverterParameters(computation_delay=0.5)},
    ],
    ids=lambda on: next(iter(on)),
)
def test_an_effect_that_is_on_changes_the_samples(paper, on):
    assert not run_paper(PlantParameters(**on)).identical_to(paper)


# -- iron


def test_flux_that_circulates_in_a_ring_decays_by_its_eddy_currents():
    """Its time constant is that of a lamination, sigma mu d^2 / 12, and its loss the energy of its field."""
    circuit = MagneticCircuitParameters()
    plant = Plant(
        PlantParameters(iron=SATURATING, rotor=HELD, amplifier=AmplifierParameters(bias_current=0.0, switching=False))
    )
    reluctivity = float(saturation_curve(SATURATING).differential_reluctivity(np.array(0.0)))
    time_constant = circuit.iron_conductivity * circuit.lamination_thickness**2 / (12.0 * reluctivity)
    back_iron = plant._arrays.bearings[0]["ring"]
    start = 1e-6  # Wb, small enough for the iron to be linear
    back_iron["flux"][0] = start
    plant.advance((0.0, 0.0))
    after = start * np.exp(-plant.sample_time / time_constant)
    assert back_iron["flux"][0] == pytest.approx(after, rel=5e-3)
    assert back_iron["flux"][1] == pytest.approx(0.0, abs=1e-6 * start)
    length, area = plant.network.paths[1]
    energy = 0.5 * 8.0 * length / area * reluctivity * (start**2 - after**2)
    assert back_iron["loss"] == pytest.approx(energy, rel=1e-2)


# -- amplifiers


def test_dead_time_takes_twice_the_supply_voltage_for_its_share_of_the_period():
    dead_time = 0.3e-6
    amplifier = AmplifierParameters(dead_time=dead_time, proportional_gain=0.0, integral_gain=0.0)
    voltage = Plant(PlantParameters(amplifier=amplifier, rotor=HELD)).trace((0.0, 0.0)).voltage
    expected = -2.0 * amplifier.supply_voltage * dead_time * amplifier.switching_frequency
    np.testing.assert_allclose(voltage.mean(axis=0), expected, rtol=1e-9)


def test_averaged_amplifiers_lose_the_same_voltage_to_dead_time():
    dead_time = 0.3e-6
    amplifier = AmplifierParameters(dead_time=dead_time, proportional_gain=0.0, integral_gain=0.0, switching=False)
    voltage = Plant(PlantParameters(amplifier=amplifier, rotor=HELD)).trace((0.0, 0.0)).voltage
    expected = -2.0 * amplifier.supply_voltage * dead_time * amplifier.switching_frequency
    np.testing.assert_allclose(voltage, expected, rtol=1e-9)


def test_interleaved_carriers_have_the_same_mean_currents_and_a_smaller_ripple_of_their_sum():
    ripples, means = [], []
    for carriers in ("synchronous", "interleaved"):
        plant = Plant(PlantParameters(amplifier=AmplifierParameters(carriers=carriers), rotor=HELD))
        plant.trace((0.4, -0.2), samples=5)
        current = plant.trace((0.4, -0.2), samples=5).current
        ripples.append(np.ptp(current.sum(axis=1)))
        means.append(current.mean(axis=0))
    assert ripples[1] < 0.5 * ripples[0]
    np.testing.assert_allclose(means[1], means[0], atol=2e-3)


# -- sensors, converters, computer


def test_sensor_lags_a_falling_rotor_as_a_first_order_low_pass():
    bandwidth = 500.0
    lag = 1.0 / (TWO_PI * bandwidth)
    plant = Plant(PlantParameters(amplifier=WITHOUT_FORCE, sensor=SensorParameters(bandwidth=bandwidth)))
    for _ in range(60):
        plant.advance((0.0, 0.0))
    time = plant.samples * plant.sample_time
    fall = -0.5 * GRAVITY * (time**2 - 2.0 * lag * time + 2.0 * lag**2 * -np.expm1(-time / lag))
    drawn = plant.snapshot().position[0, 1] / (-0.5 * GRAVITY * time**2)  # the rotor does not fall quite freely
    assert drawn == pytest.approx(1.0, abs=1e-3)
    assert plant.position[1] / drawn == pytest.approx(fall, rel=1e-4)


def test_computation_delay_shifts_the_response_by_itself():
    """Of a sample of 0.1 ms, 0.4 is two samples of a plant with a sample time of 20 us."""
    late = Plant(PlantParameters(converters=ConverterParameters(computation_delay=0.4)))
    fine = Plant(PlantParameters(integration=IntegrationParameters(sample_rate=50e3)))
    for before, now in itertools.pairwise([0.0, 0.5, -0.3, 0.2]):
        late.advance((now, -now))
        for sample in range(5):
            held = before if sample < 2 else now
            fine.advance((held, -held))
        assert late.position == fine.position


def test_a_whole_sample_of_delay_is_the_command_of_the_sample_before():
    late, prompt = Plant(PlantParameters(converters=ConverterParameters(computation_delay=1.0))), Plant()
    for before, now in itertools.pairwise([0.0, 0.5, -0.3, 0.2]):
        assert late.advance((now, -now)) == prompt.advance((before, -before))


@pytest.mark.parametrize("part", ["radial", "axial"])
def test_a_rotor_that_touches_before_the_late_currents_and_recedes_ends_the_run(part):
    """At 250 um: 2 um beyond when the new currents begin, half a sample late, and 2 um inside at the end."""
    converters = ConverterParameters(computation_delay=0.5)
    plant = Plant(PlantParameters(converters=converters, rotor=RotorParameters(axial=part == "axial", gravity=0.0)))
    state = plant._arrays.bearings[0] if part == "radial" else plant.axial._state[0]
    for name, value in (("position", 254e-6), ("velocity", -0.08)):
        state[name] = (value, 0.0) if part == "radial" else value
    position = plant.advance(np.zeros(len(plant.machine.axes)))
    assert max(position) < 250e-6
    assert plant.delevitated


def test_measured_positions_lie_on_the_grid_of_their_converter():
    resolution = 30e-9
    plant = Plant(PlantParameters(converters=ConverterParameters(position_resolution=resolution)))
    for _ in range(20):
        steps = np.array(plant.advance((0.3, 1.0))) / resolution
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
        true = plant.snapshot().position[0] / resolution
        assert np.abs(steps - true).max() <= 0.5 + 1e-9
    assert np.abs(steps).max() > 10


def test_current_references_lie_on_the_grid_of_their_converter():
    coarse, ideal = Plant(PlantParameters(converters=ConverterParameters(current_resolution=0.1))), Plant()
    for wanted, nearest in ((0.234, 0.2), (-0.07, -0.1), (1.0499, 1.0)):
        assert coarse.advance((wanted, wanted)) == pytest.approx(ideal.advance((nearest, nearest)), rel=1e-12)


def test_noise_has_its_standard_deviation_and_is_the_same_after_every_reset():
    noise, samples = 0.2e-6, 4_000
    plant = Plant(
        PlantParameters(
            sensor=SensorParameters(noise=noise),
            rotor=HELD,
            amplifier=AmplifierParameters(switching=False),
            integration=IntegrationParameters(sample_rate=100e3, internal_step=1e-6),
        )
    )

    def measured() -> np.ndarray:
        plant.reset()
        return np.array([plant.position, *(plant.advance((0.0, 0.0)) for _ in range(samples - 1))])

    first = measured()
    assert np.array_equal(measured(), first)
    # of n samples, a standard deviation is uncertain by 1 / sqrt(2 n) of itself, their mean by 1 / sqrt(n)
    np.testing.assert_allclose(first.std(axis=0), noise, rtol=4.0 / np.sqrt(2.0 * samples))
    assert np.abs(first.mean(axis=0)).max() < 4.0 * noise / np.sqrt(samples)
    correlation = np.corrcoef(np.column_stack([first[1:], first[:-1]]).T)
    assert np.abs(correlation - np.eye(4)).max() < 5.0 / np.sqrt(samples)


def test_another_seed_gives_other_noise():
    one, other = (Plant(PlantParameters(sensor=SensorParameters(noise=1e-7, noise_seed=seed))) for seed in (1, 2))
    assert one.position != other.position


# -- bearings with one degree of freedom


@pytest.mark.parametrize("coupling", [True, False])
def test_top_coil_alone_pulls_up_with_the_textbook_force(coupling):
    circuit = MagneticCircuitParameters(actuators="top_coil", relative_permeability=1e12, coupling=coupling)
    plant = Plant(PlantParameters(magnetic_circuit=circuit, rotor=HELD, amplifier=AmplifierParameters(switching=False)))
    for current in (2.0, 4.0):
        for _ in range(10):
            plant.advance((0.0, current - 3.0))
        snapshot = plant.snapshot()
        coil = snapshot.coil_current[0]
        assert coil[1] == pytest.approx(current, abs=2e-3)
        assert np.abs(coil[[0, 2, 3]]).max() == 0.0
        expected = force_constant(circuit) * coil[1] ** 2 / circuit.air_gap**2
        np.testing.assert_allclose(snapshot.force[0], [0.0, expected], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(("actuators", "bias"), [("top_coil", 3.4), ("differential", 3.0)])
def test_with_one_degree_of_freedom_the_rotor_moves_along_y_only(actuators, bias):
    plant = Plant(
        PlantParameters(
            magnetic_circuit=MagneticCircuitParameters(actuators=actuators),
            amplifier=AmplifierParameters(bias_current=bias),
            rotor=RotorParameters(initial_x=10e-6, initial_y=-20e-6),
        )
    )
    settled = joined(levitate(plant, 1_500)[-100:], "position")
    assert np.all(settled[:, 0] == 10e-6)
    assert np.ptp(settled[:, 1]) < 1e-6
    assert np.abs(settled[:, 1]).max() < 80e-6
    assert plant.axes == ("y",)


# -- disturbances


def test_constant_force_deflects_by_the_stiffness_of_the_loop():
    force = 1.0
    plant = Plant(PlantParameters(magnetic_circuit=IDEAL, rotor=RotorParameters(gravity=0.0, external_force_x=force)))
    settled = joined(levitate(plant, 2_000)[-100:], "position").mean(axis=0)
    stiffness = current_gain(IDEAL, 3.0) * 20_000.0 - negative_stiffness(IDEAL, 3.0)
    assert settled[0] == pytest.approx(force / stiffness, rel=2e-3)
    assert settled[1] == pytest.approx(0.0, abs=1e-12)


def test_unbalance_whirls_with_the_amplitude_of_the_linear_loop():
    """G_f / (1 + G H K) at the running speed, with the hold H and the controller K of the sampled loop."""
    speed, unbalance = 40.0, 2e-6
    rotor = RotorParameters(gravity=0.0, running_speed=speed, unbalance=unbalance)
    plant = Plant(PlantParameters(rotor=rotor))
    traces = levitate(plant, 3_000)[-250:]  # the last revolution
    assert np.hypot(*traces[-1].position[-1]) > 1e-7
    turn = TWO_PI * speed * (np.arange(250 * 200) + 2_750 * 200) * 0.5e-6
    x, y = joined(traces, "position").T
    measured_x, measured_y = (2.0 * np.mean(signal * np.exp(-1j * turn)) for signal in (x, y))

    system, s, step = linearize(plant).continuous, 2j * np.pi * speed, plant.sample_time
    resolvent = np.linalg.inv(s * np.eye(system.order) - system.a)
    along_x = resolvent[system.state_names.index("x")]
    by_force, by_current = along_x[system.state_names.index("v_x")] / MASS, along_x @ system.b[:, 0]
    hold = -np.expm1(-s * step) / (s * step)
    controller = 20_000.0 + 38.0 * -np.expm1(-s * step) / step
    expected = unbalance * (TWO_PI * speed) ** 2 * by_force / (1.0 + by_current * hold * controller)
    assert measured_x == pytest.approx(expected, rel=1e-2)
    assert measured_y == pytest.approx(-1j * expected, rel=1e-2)  # from +x to +y
