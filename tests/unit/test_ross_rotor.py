"""Modal data from a ROSS rotor against ROSS's own results: an overhung rotor on springs.

The rotor's matrices and what ROSS computes of it are kept in `data/ross_rotor.npz`, so that ROSS is needed only to make
that file anew, `python tests/unit/test_ross_rotor.py`, and to check it. The one there is from ROSS 2.3.0.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.plant.modal_data import ModalData
from amb_core.plant.ross_rotor import modal_data_from_ross
from amb_core.plant.rotor import RotorModel, modal_rotor

REFERENCE = Path(__file__).parent / "data" / "ross_rotor.npz"
BEARINGS, SENSORS, DISC = (3, 11), (4, 10), 14  # nodes
CASES = np.array([[1e6, 1e6, 0.0], [1e6, 1e6, 1000.0], [1e6, 5e5, 0.0], [1e6, 5e5, 1000.0]])
"""Stiffness along x and y (N/m) and running speed (rad/s)."""
FREQUENCIES = 6
SECTIONS = ((0.06, 0.030), (0.05, 0.070), (0.08, 0.035), (0.04, 0.060), (0.08, 0.035), (0.05, 0.070), (0.10, 0.030))
"""Length and diameter of the sections of the shaft (m), two elements each."""
DENSITY, DISC_MASS, DISC_TRANSVERSE_INERTIA, DISC_POLAR_INERTIA = 7810.0, 4.0, 0.012, 0.022  # kg/m^3, kg, kg m^2
UNBALANCE, UNBALANCE_SPEED = 1e-4, 1500.0  # kg m, rad/s
GRAVITY = 9.81
TOLERANCE = 1e-3


# -- what ROSS says


def ross_rotor(stiffness_x: float, stiffness_y: float) -> Any:
    """Shaft with thick journals and a thick middle, and a disc at its end."""
    ross = pytest.importorskip("ross")
    steel = ross.Material("steel", rho=DENSITY, E=211e9, G_s=81.2e9)
    shaft = [
        ross.ShaftElement(0.5 * length, 0.0, diameter, material=steel)
        for length, diameter in SECTIONS
        for _ in range(2)
    ]
    disc = ross.DiskElement(DISC, m=DISC_MASS, Id=DISC_TRANSVERSE_INERTIA, Ip=DISC_POLAR_INERTIA)
    springs = [ross.BearingElement(node, kxx=stiffness_x, kyy=stiffness_y, cxx=0.0) for node in BEARINGS]
    return ross.Rotor(shaft, [disc], springs, tag="overhung")


def ross_results() -> dict[str, Any]:
    """The rotor's matrices and ROSS's results.

    Frequencies (Hz) of the first lateral modes on springs; whirl of those of the second case; displacements (m) at the
    sensors A x, A y, B x, B y of the last case by weight, and by unbalance as complex amplitudes.
    """
    frequencies = np.empty((len(CASES), FREQUENCIES))
    for case, (stiffness_x, stiffness_y, speed) in enumerate(CASES):
        rotor = ross_rotor(stiffness_x, stiffness_y)
        modal = rotor.run_modal(speed, num_modes=40)
        lateral = modal.whirl_direction() != "None"  # others are axial or torsion
        frequencies[case] = np.sort(modal.wd[lateral])[:FREQUENCIES] / (2.0 * np.pi)
        if case == 1:
            forward = (modal.whirl_direction()[lateral] == "Forward")[np.argsort(modal.wd[lateral])][:FREQUENCIES]
    sensors = [rotor.number_dof * node + axis for node in SENSORS for axis in (0, 1)]
    sag = np.linalg.lstsq(rotor.K(0.0), rotor.gravitational_force(-GRAVITY))[0]  # nothing holds it along and about z
    response = rotor.run_unbalance_response(DISC, UNBALANCE, 0.0, np.array([UNBALANCE_SPEED])).forced_resp
    matrices = {name: getattr(rotor, name) for name in ("M0", "K0", "G0", "nodes", "nodes_pos", "number_dof", "ndof")}
    return matrices | {
        "bearing_nodes": BEARINGS,
        "cases": CASES,
        "frequencies": frequencies,
        "forward": forward,
        "sag": sag[sensors],
        "response": response[sensors, 0],
    }


@pytest.fixture(scope="module")
def reference() -> dict[str, Any]:
    with np.load(REFERENCE) as archive:
        return {name: archive[name] for name in archive.files}


def stored_rotor(reference: dict[str, Any], **changes: Any) -> Any:
    """What the loader sees of the ROSS rotor."""
    shaft = SimpleNamespace(dof_mapping=lambda: {"x_0": 0, "y_0": 1, "z_0": 2, "alpha_0": 3, "beta_0": 4, "theta_0": 5})
    attributes = {name: reference[name] for name in ("M0", "K0", "G0", "nodes_pos")}
    attributes |= {"nodes": reference["nodes"].tolist(), "tag": "overhung", "shaft_elements": [shaft]}
    attributes |= {name: int(reference[name]) for name in ("number_dof", "ndof")}
    return SimpleNamespace(**attributes | changes)


def loaded(rotor: Any, **options: Any) -> ModalData:
    options = {"sensor_nodes": SENSORS, "unbalance_node": DISC, "bending_modes": 4, "damping_ratio": 0.0} | options
    return modal_data_from_ross(rotor, BEARINGS, **options)


# -- the loader against ROSS


def springs(case: int) -> np.ndarray:
    return np.tile(CASES[case, :2], 2)


def model(reference: dict[str, Any], speed: float) -> RotorModel:
    return modal_rotor(loaded(stored_rotor(reference)), GRAVITY, speed / (2.0 * np.pi))


@pytest.mark.parametrize("case", range(len(CASES)))
def test_frequencies_on_springs_are_those_of_ross(reference, case):
    """Rigid body modes and the first bending modes, at rest and turning; what is missing are the modes left out."""
    frequencies = model(reference, CASES[case, 2]).natural_frequencies(springs(case))
    assert frequencies[:FREQUENCIES] == pytest.approx(reference["frequencies"][case], rel=TOLERANCE)


def test_modes_whirl_in_the_direction_that_ross_says(reference):
    rotor, rates = model(reference, CASES[1, 2]), 2.0 * np.pi * reference["frequencies"][1]
    stiffness = rotor.stiffness + (rotor.bearings.T * springs(1)) @ rotor.bearings
    # In complex notation x + j y a forward mode turns with +j omega, a backward mode with -j omega.
    to_complex = np.kron(np.eye(rotor.n // 2), [[1.0], [-1.0j]])
    for rate, forward in zip(rates, reference["forward"], strict=True):
        turning = to_complex if forward else to_complex.conj()
        dynamic = stiffness - rate**2 * rotor.mass + 1j * rate * rotor.gyroscopic
        singular = np.linalg.svd(turning.conj().T @ dynamic @ turning, compute_uv=False)
        assert singular[-1] < 1e-3 * rate**2
    assert reference["forward"].tolist() == [False, True] * 3


def test_sag_is_that_of_ross(reference):
    rotor = model(reference, 0.0)
    stiffness = rotor.stiffness + (rotor.bearings.T * springs(3)) @ rotor.bearings
    sag = rotor.sensors @ np.linalg.solve(stiffness, rotor.weight)
    assert sag == pytest.approx(reference["sag"], rel=TOLERANCE, abs=1e-9)
    assert sag[1] < 0.0


def test_response_to_unbalance_is_that_of_ross(reference):
    """In amplitude and phase at the sensors: it fixes the direction of rotation and the sign of the gyroscopic term."""
    rotor, speed = model(reference, UNBALANCE_SPEED), UNBALANCE_SPEED
    stiffness = rotor.stiffness + (rotor.bearings.T * springs(3)) @ rotor.bearings
    dynamic = stiffness - speed**2 * rotor.mass + 1j * speed * (rotor.damping + rotor.gyroscopic)
    force = UNBALANCE * speed**2 * np.array([1.0, -1.0j])
    response = rotor.sensors @ np.linalg.solve(dynamic, rotor.unbalance.T @ force)
    assert response == pytest.approx(reference["response"], rel=2e-3)


def test_rigid_body_modes_have_the_mass_and_inertias_of_the_rotor(reference):
    length, diameter = np.array(SECTIONS).T
    masses = np.append(DENSITY * 0.25 * np.pi * diameter**2 * length, DISC_MASS)
    centres = np.append(np.cumsum(length) - 0.5 * length, length.sum())
    centre = masses @ centres / masses.sum()
    polar = np.append(masses[:-1] * diameter**2 / 8.0, DISC_POLAR_INERTIA)
    transverse = np.append(masses[:-1] * (diameter**2 / 16.0 + length**2 / 12.0), DISC_TRANSVERSE_INERTIA)
    about_centre = transverse.sum() + masses @ (centres - centre) ** 2

    data = loaded(stored_rotor(reference))
    assert data.natural_frequencies[:4].tolist() == [0.0] * 4
    assert data.weight == pytest.approx([0.0, -np.sqrt(masses.sum())] + [0.0] * (data.modes - 2), rel=1e-9, abs=1e-9)
    assert data.bearings[0, 0] == pytest.approx(1.0 / np.sqrt(masses.sum()))
    bearing_b = np.array(reference["nodes_pos"])[BEARINGS[1]] - centre
    assert data.bearings[2, 2] == pytest.approx(bearing_b / np.sqrt(about_centre))
    assert data.gyroscopic[2, 3] == pytest.approx(polar.sum() / about_centre, rel=1e-9)


def test_nodes_decide_what_the_bearings_and_sensors_see(reference):
    rotor = stored_rotor(reference)
    data = loaded(rotor, sensor_nodes=None, unbalance_node=None)
    assert np.array_equal(data.sensors, data.bearings)
    at_nodes = [loaded(rotor, unbalance_node=node).unbalance for node in rotor.nodes]
    nearest = np.argmin([abs(shapes[0, 2]) for shapes in at_nodes])  # the rotor tilts about its centre of mass
    assert np.array_equal(data.unbalance, at_nodes[nearest])
    assert "bearings at nodes 3 and 11, sensors at 3 and 11" in data.description


def test_number_of_bending_modes_and_their_damping_are_chosen(reference):
    rotor = stored_rotor(reference)
    rigid = loaded(rotor, bending_modes=0)
    assert rigid.natural_frequencies.tolist() == [0.0] * 4
    data = loaded(rotor, bending_modes=2, damping_ratio=0.01)
    assert data.damping_ratios.tolist() == [0.0] * 4 + [0.01] * 4
    assert np.all(np.diff(data.natural_frequencies[4::2]) > 0.0)


# -- what it refuses


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"sensor_nodes": (4, 15)}, "sensor_nodes has 15; allowed: nodes 0 to 14"),
        ({"sensor_nodes": (10, 4)}, r"sensor_nodes = \[10, 4\]; A, the first, must be the node at smaller z"),
        ({"sensor_nodes": (4, 10, 12)}, r"sensor_nodes = \[4, 10, 12\]; needed: two nodes"),
        ({"unbalance_node": -1}, "unbalance_node has -1; allowed: nodes 0 to 14"),
        ({"bending_modes": 15}, "bending_modes = 15; allowed: 0 to 14"),
        ({"bending_modes": -1}, "bending_modes = -1; allowed: 0 to 14"),
        ({"damping_ratio": -0.1}, "'damping_ratios' has -0.1 for mode 5; allowed: 0 to 1"),
    ],
)
def test_what_the_rotor_does_not_have_is_refused(reference, options, reason):
    with pytest.raises(PlantError, match=reason):
        loaded(stored_rotor(reference), **options)


def test_shaft_that_is_held_is_refused(reference):
    stiffness = reference["K0"].copy()
    held = [axis + 6 * BEARINGS[0] for axis in (0, 1)]
    stiffness[held, held] += 1e6
    with pytest.raises(PlantError, match="something other than its bearings holds the shaft"):
        loaded(stored_rotor(reference, K0=stiffness))


def test_shaft_that_falls_apart_is_refused(reference):
    """The stiffness against moving one node alone is taken out."""
    stiffness = reference["K0"].copy()
    for moved in (6 * 7, 6 * 7 + 1):
        forces = stiffness[moved].copy()
        stiffness -= np.outer(forces, forces) / forces[moved]
    with pytest.raises(PlantError, match="moves in more than two ways without bending"):
        loaded(stored_rotor(reference, K0=stiffness))


@pytest.mark.parametrize(("matrix", "row", "column"), [("K0", 6, 6), ("M0", 7, 7), ("K0", 6, 8), ("G0", 6, 6)])
def test_rotor_that_is_not_axisymmetric_is_refused(reference, matrix, row, column):
    changed = reference[matrix].copy()
    changed[row, column] += 0.01 * np.abs(changed).max()
    with pytest.raises(PlantError, match=f"ROSS rotor 'overhung': its matrix {matrix} is not that of an axisymmetric"):
        loaded(stored_rotor(reference, **{matrix: changed}))


# -- with ROSS


def test_stored_results_are_those_of_the_installed_ross(reference):
    results = ross_results()
    assert results.keys() == reference.keys()
    for name, value in results.items():
        assert np.asarray(value) == pytest.approx(reference[name], rel=1e-6, abs=1e-12), name


def test_rotor_of_ross_is_loaded_like_the_stored_one(reference):
    ours, stored = loaded(ross_rotor(1e6, 1e6)), loaded(stored_rotor(reference))
    assert ours.bearings == pytest.approx(stored.bearings, rel=1e-9)
    assert ours.gyroscopic == pytest.approx(stored.gyroscopic, abs=1e-9)
    assert ours.description == stored.description


def test_rotor_of_two_shafts_is_refused():
    ross = pytest.importorskip("ross")
    with pytest.raises(PlantError, match="needed: one shaft without hinges"):
        modal_data_from_ross(ross.coaxrotor_example(), (0, 3))


if __name__ == "__main__":
    np.savez_compressed(REFERENCE, **ross_results())
