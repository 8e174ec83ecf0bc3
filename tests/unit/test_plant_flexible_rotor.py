"""A flexible rotor in the running plant: a uniform beam in two magnetic bearings."""

import numpy as np
import pytest
from scipy.optimize import brentq

from amb_core.linear import rates_of
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters, RotorParameters, Trace, linearize
from amb_core.plant.modal_data import ModalData
from amb_core.plant.parameters import FlexibleRotorParameters
from tests.validation.energy import EnergyAccount

GRAVITY = 9.81
TWO_PI = 2.0 * np.pi
BEAM_MASS, FIRST_BENDING = 12.5, 180.0  # kg, Hz
BEARINGS = np.array([0.1, 0.85])  # over the length


def beam(bending_modes: int = 2) -> ModalData:
    """A uniform free beam: cos(b) cosh(b) = 1."""
    near = np.pi * (np.arange(1, bending_modes + 1) + 0.5)
    roots = [brentq(lambda b: np.cos(b) - 1.0 / np.cosh(b), a - 0.5, a + 0.5) for a in near]

    def shapes(z: np.ndarray) -> np.ndarray:
        columns = [np.ones_like(z), np.sqrt(12.0) * (z - 0.5)]
        for b in roots:
            ratio = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
            columns.append(np.cosh(b * z) + np.cos(b * z) - ratio * (np.sinh(b * z) + np.sin(b * z)))
        return np.kron(np.column_stack(columns) / np.sqrt(BEAM_MASS), np.eye(2))

    bending = FIRST_BENDING * (np.array(roots) / roots[0]) ** 2
    weight = np.zeros(2 * len(roots) + 4)
    weight[1] = -np.sqrt(BEAM_MASS)
    return ModalData(
        natural_frequencies=np.repeat(np.concatenate([[0.0, 0.0], bending]), 2),
        damping_ratios=np.full(len(weight), 0.005),
        bearings=shapes(BEARINGS),
        sensors=shapes(BEARINGS + np.array([-0.03, 0.03])),
        unbalance=shapes(np.array([0.5])),
        weight=weight,
        gyroscopic=np.zeros((len(weight), len(weight))),
    )


@pytest.fixture(scope="module")
def flexible(tmp_path_factory) -> tuple[Plant, EnergyAccount, list[Trace]]:
    """A levitated beam that rings after a force at its first bending frequency."""
    path = tmp_path_factory.mktemp("beam") / "beam.npz"
    beam().save(path)
    plant = Plant(
        PlantParameters(
            rotor=RotorParameters(model="flexible"),
            flexible_rotor=FlexibleRotorParameters(modal_data=str(path)),
        )
    )
    account, controller = EnergyAccount(plant), PdController(ControllerParameters(), axes=4)
    traces = []
    for sample in range(2_500):
        kick = 1e-6 if sample == 1_000 else 0.0
        traces.append(plant.trace(controller.update(plant.position, (kick, 0.0, 0.0, 0.0))))
        account.add(traces[-1])
    return plant, account, traces


def test_flexible_rotor_levitates_with_the_weight_shared_by_both_bearings(flexible):
    plant, _, traces = flexible
    bearings = [traces[-50:], [trace.bearing_b for trace in traces[-50:]]]
    force_a, force_b = (np.mean([trace.force[:, 1] for trace in bearing]) for bearing in bearings)
    lever = (BEARINGS[1] - 0.5) / (BEARINGS[1] - BEARINGS[0])
    assert force_a == pytest.approx(BEAM_MASS * GRAVITY * lever, rel=1e-2)
    assert force_b == pytest.approx(BEAM_MASS * GRAVITY * (1.0 - lever), rel=1e-2)
    assert not plant.delevitated


def test_flexible_rotor_rings_at_its_first_bending_frequency_in_the_bearings(flexible):
    plant, _, traces = flexible
    coordinate = np.array([trace.coordinates[0, 4] for trace in traces[1_001:]])
    rings_at = ringing_frequency(coordinate - coordinate[-20:].mean(), plant.sample_time)
    closed_loop = linearize(plant).closed_loop
    loop = rates_of(closed_loop.poles(), closed_loop.sample_time).imag / TWO_PI
    bending = loop[(loop > 100.0) & (loop < 300.0)]
    assert np.abs(bending / rings_at - 1.0).min() < 5e-3
    free = plant.rotor.natural_frequencies()[4]
    assert rings_at == pytest.approx(free, rel=0.02)  # to a beam that stiff the magnetic bearings are soft
    assert free == pytest.approx(FIRST_BENDING, rel=1e-4)  # damped


def ringing_frequency(signal: np.ndarray, sample_time: float) -> float:
    """Frequency of the largest line of the spectrum above 100 Hz (Hz)."""
    padded = 16 * len(signal)
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(len(signal)), padded))
    frequency = np.fft.rfftfreq(padded, sample_time)
    spectrum[frequency < 100.0] = 0.0
    return float(frequency[spectrum.argmax()])


def test_energy_of_the_flexible_rotor_is_in_balance(flexible):
    _, account, _ = flexible
    assert account.strain > 0.0
    assert account.damping > 0.0
    assert abs(account.rotor_residual) < 1e-4 * account.work
    assert abs(account.circuit_residual) < 1e-4 * account.electrical
