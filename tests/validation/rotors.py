"""Rotors in two bearings: frequencies against formulas, a uniform beam, and ROSS."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from amb_core.plant import PlantParameters, RotorParameters
from amb_core.plant.modal_data import ModalData
from amb_core.plant.parameters import RigidRotorParameters
from amb_core.plant.ross_rotor import modal_data_from_ross
from amb_core.plant.rotor import RotorModel, modal_rotor, rigid_rotor
from tests.validation.row import Row

SPEED = 200.0  # Hz
STIFFNESS = 3e5  # N/m
ROSS_RESULTS = Path(__file__).parents[1] / "unit" / "data" / "ross_rotor.npz"  # see tests/unit/test_ross_rotor.py
BEAM_MODES = 6
BEAM_STIFFNESS = (5.0, 50.0)  # of the springs, over E I / l^3


def rows() -> Iterator[Row]:
    """Relative deviations of natural frequencies; for the free rotor, the largest frequency that should be zero."""
    yield from _rigid()
    yield from _beam()
    yield from _ross()


# -- rigid rotor


def _rigid() -> Iterator[Row]:
    body = RigidRotorParameters()
    mass, transverse, polar = body.mass, body.transverse_inertia, body.polar_inertia
    arms = body.bearing_a**2 + body.bearing_b**2
    still, turning = _rigid_rotor(body, 0.0), _rigid_rotor(body, SPEED)
    yield Row("rigid rotor, free: frequency of the rigid body modes", still.natural_frequencies().max(), 1e-6, "Hz")
    bounce, tilt = np.sqrt(2.0 * STIFFNESS / mass), np.sqrt(STIFFNESS * arms / transverse)
    expected = np.array([bounce, bounce, tilt, tilt]) / (2.0 * np.pi)
    yield _deviation("rigid rotor on springs: bounce and tilt", still.natural_frequencies(STIFFNESS), expected, 1e-9)

    hinged = RigidRotorParameters(bearing_a=-0.1, bearing_b=0.25)
    about_hinge = transverse + mass * hinged.bearing_a**2
    swing = np.sqrt(STIFFNESS * (hinged.bearing_b - hinged.bearing_a) ** 2 / about_hinge) / (2.0 * np.pi)
    springs = np.array([1e13, 1e13, STIFFNESS, STIFFNESS])
    pendulum = _rigid_rotor(hinged, 0.0).natural_frequencies(springs)[:2]
    yield _deviation("rigid rotor hinged in bearing A: physical pendulum", pendulum, np.full(2, swing), 1e-6)

    nutation = turning.natural_frequencies()[-1:]
    yield _deviation("rigid rotor, free, 200 Hz: nutation", nutation, np.array([polar / transverse * SPEED]), 1e-9)
    half = 0.5 * polar * 2.0 * np.pi * SPEED
    root = np.sqrt(half**2 + STIFFNESS * arms * transverse)
    conical = np.array([root - half, root + half]) / transverse / (2.0 * np.pi)
    expected = np.concatenate([conical, expected[:2]])
    yield _deviation(
        "rigid rotor on springs, 200 Hz: backward and forward conical mode",
        turning.natural_frequencies(STIFFNESS),
        expected,
        1e-9,
    )


def _rigid_rotor(body: RigidRotorParameters, running_speed: float) -> RotorModel:
    rotor = RotorParameters(model="rigid", running_speed=running_speed)
    return rigid_rotor(PlantParameters(rotor=rotor, rigid_rotor=body))


# -- uniform beam of Euler and Bernoulli, of unit length, mass and bending stiffness, in springs at its ends


def _beam() -> Iterator[Row]:
    rotor = modal_rotor(_beam_modes(), gravity=0.0, running_speed=0.0)
    free = np.array([4.730040744862704, 7.853204624095838]) ** 2 / (2.0 * np.pi)
    yield _deviation("uniform beam, free: first two bending modes", rotor.natural_frequencies()[4:8:2], free, 1e-9)
    for stiffness in BEAM_STIFFNESS:
        yield _deviation(
            f"uniform beam on springs of {stiffness:g} E I / l^3, {BEAM_MODES} bending modes: first four frequencies",
            rotor.natural_frequencies(stiffness)[:8:2],
            _beam_on_springs(stiffness),
            1e-3,
        )


def _beam_modes() -> ModalData:
    """Exact modes of the free beam: cos(b) cosh(b) = 1, with displacement 2 at the ends, frequency b^2."""
    near = np.arange(1, BEAM_MODES + 1) + 0.5
    roots = np.array([brentq(lambda b: np.cos(b) - 1.0 / np.cosh(b), *(np.pi * n + [-0.5, 0.5])) for n in near])
    left = np.concatenate([[1.0, -np.sqrt(3.0)], 2.0 * (-1.0) ** np.arange(BEAM_MODES)])  # even, odd, even, ...
    right = np.concatenate([[1.0, np.sqrt(3.0)], np.full(BEAM_MODES, 2.0)])
    ends = np.kron([left, right], np.eye(2))
    n = ends.shape[1]
    return ModalData(
        natural_frequencies=np.repeat(np.concatenate([np.zeros(2), roots**2 / (2.0 * np.pi)]), 2),
        damping_ratios=np.zeros(n),
        bearings=ends,
        sensors=ends,
        unbalance=ends[:2],
        weight=np.zeros(n),
        gyroscopic=np.zeros((n, n)),
    )


def _beam_on_springs(stiffness: float) -> NDArray[np.float64]:
    """First four frequencies (Hz) from the boundary conditions w'' = 0, w''' = k w at the end of either half.

    Symmetric motion: b^3 (tan(b/2) + tanh(b/2)) = 2 k; antisymmetric: b^3 (coth(b/2) - cot(b/2)) = 2 k.
    """
    tiny = 1e-9

    def symmetric(b: float) -> float:
        return b**3 * (np.tan(0.5 * b) + np.tanh(0.5 * b)) - 2.0 * stiffness

    def antisymmetric(b: float) -> float:
        return b**3 * (1.0 / np.tanh(0.5 * b) - 1.0 / np.tan(0.5 * b)) - 2.0 * stiffness

    branches = ((symmetric, 0, 1), (antisymmetric, 0, 2), (symmetric, 1, 3), (antisymmetric, 2, 4))  # between poles
    roots = [brentq(condition, np.pi * a + 1e-6, np.pi * b - tiny) for condition, a, b in branches]
    return np.sort(np.array(roots) ** 2) / (2.0 * np.pi)


# -- ROSS


def _ross() -> Iterator[Row]:
    with np.load(ROSS_RESULTS) as archive:
        kept = {name: archive[name] for name in archive.files}
    shaft = SimpleNamespace(dof_mapping=lambda: {"x_0": 0, "y_0": 1, "alpha_0": 3, "beta_0": 4})
    rotor = SimpleNamespace(**kept | {"tag": "overhung", "nodes": kept["nodes"].tolist(), "shaft_elements": [shaft]})
    data = modal_data_from_ross(rotor, kept["bearing_nodes"].tolist(), bending_modes=4, damping_ratio=0.0)
    for (stiffness_x, stiffness_y, speed), expected in zip(kept["cases"], kept["frequencies"], strict=True):
        model = modal_rotor(data, gravity=0.0, running_speed=speed / (2.0 * np.pi))
        frequencies = model.natural_frequencies(np.array([stiffness_x, stiffness_y] * 2))
        yield _deviation(
            f"ROSS rotor on springs of {stiffness_x:.3g} and {stiffness_y:.3g} N/m, {speed:.0f} rad/s: first "
            f"{len(expected)} frequencies, 4 bending modes, against ROSS",
            frequencies[: len(expected)],
            expected,
            1e-3,
        )


def _deviation(name: str, measured: NDArray[np.float64], expected: NDArray[np.float64], limit: float) -> Row:
    return Row(f"{name}: relative", float(np.abs(measured / np.sort(expected) - 1.0).max()), limit, "-")
