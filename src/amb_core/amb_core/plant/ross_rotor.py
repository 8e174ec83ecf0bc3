"""Modal data from a rotor modelled in ROSS (ross-rotordynamics), for users with ROSS models of their machines.

    import ross

    from amb_core.plant.ross_rotor import modal_data_from_ross

    rotor = ross.Rotor.load("rotor.toml")
    modal_data_from_ross(rotor, bearing_nodes=(4, 22)).save("rotor.npz")

`amb plant ross` makes a whole machine of it.

ROSS has the same axes as this library: x horizontal, y up, z along the shaft with ascending nodes, and its speed turns
+x to +y. Its alpha turns about +x and its beta about +y, so the axis tilts by dx/dz = beta and dy/dz = -alpha.

Shafts, discs and masses on nodes of the shaft are used. Bearings, seals and supports are not: the magnetic bearings
replace them. ROSS's material damping is not used either; all bending modes have one damping ratio.

Source: Timbó et al., "ROSS - Rotordynamic Open Source Software", J. Open Source Software 5 (2020) 2120.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.given_values import kind_of
from amb_core.plant.modal_data import ModalData

_TOLERANCE = 1e-9
"""Tolerance for elements of matrices and forces that must vanish, relative to the largest; far above rounding."""
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Planes x and y as a gyroscopic matrix connects them."""
_GAP = 1e3
"""Least ratio of the lowest bending eigenvalue to those of the rigid body modes, which are rounding errors."""


def modal_data_from_ross(
    rotor: Any,
    bearing_nodes: Sequence[int],
    sensor_nodes: Sequence[int] | None = None,
    unbalance_node: int | None = None,
    bending_modes: int = 3,
    damping_ratio: float = 0.005,
) -> ModalData:
    """Rigid body modes and lowest bending modes of a ROSS rotor, free and at standstill.

    Modes come in pairs, one along x and one along y: translation, tilt about the centre of mass, then bending.

    Parameters
    ----------
    rotor : ross.Rotor
        The rotor; it need not have bearing elements.
    bearing_nodes : sequence of two int
        Nodes in bearings A and B, A at smaller z.
    sensor_nodes : sequence of two int, optional
        Nodes at the sensors of A and B; by default those in the bearings.
    unbalance_node : int, optional
        Node of the unbalance; by default the one nearest to the centre of mass.
    bending_modes : int, optional
        Number of bending modes in each plane.
    damping_ratio : float, optional
        Damping ratio of the bending modes (-).

    Returns
    -------
    ModalData
        Modes, weights and places of the rotor.

    Raises
    ------
    PlantError
        If the rotor does not have a node or that many modes, or is not a single free shaft that bends along x as it
        does along y.
    """
    if not hasattr(rotor, "nodes_pos"):
        raise PlantError(f"rotor: {kind_of(rotor)} is not allowed; allowed: a Rotor of ROSS")
    name = f"ROSS rotor '{rotor.tag}'"
    nodes, z = list(rotor.nodes), np.asarray(rotor.nodes_pos, dtype=np.float64)
    sensor_nodes = bearing_nodes if sensor_nodes is None else sensor_nodes
    bearings = _pair(name, "bearing_nodes", bearing_nodes, nodes)
    sensors = _pair(name, "sensor_nodes", sensor_nodes, nodes)
    elements = len(nodes) - 1
    if not 0 <= bending_modes <= elements:
        raise PlantError(f"{name}: bending_modes = {bending_modes}; allowed: 0 to {elements}, as many as elements")

    mass, stiffness, gyroscopic = _plane(name, rotor)
    rigid, centre = _rigid_modes(name, mass, stiffness, z)
    rates, bending = _bending_modes(name, mass, stiffness, rigid, bending_modes)
    unbalance = int(np.argmin(np.abs(z - centre)))
    if unbalance_node is not None:
        unbalance = _position(name, "unbalance_node", unbalance_node, nodes)

    shapes: NDArray[np.float64] = np.hstack([rigid, bending])
    weight = np.zeros((shapes.shape[1], 2))
    weight[:, 1] = -shapes.T @ mass @ _pose(np.ones_like(z))
    return ModalData(
        natural_frequencies=np.repeat(np.concatenate([np.zeros(2), rates / (2.0 * np.pi)]), 2),
        damping_ratios=np.repeat(np.concatenate([np.zeros(2), np.full(bending_modes, damping_ratio)]), 2),
        bearings=_in_both_planes(shapes[bearings]),
        sensors=_in_both_planes(shapes[sensors]),
        unbalance=_in_both_planes(shapes[[unbalance]]),
        weight=weight.ravel(),
        gyroscopic=np.kron(shapes.T @ gyroscopic @ shapes, _TURN),
        description=(
            f"{name}: bearings at nodes {nodes[bearings[0]]} and {nodes[bearings[1]]}, sensors at {nodes[sensors[0]]} "
            f"and {nodes[sensors[1]]}, unbalance at {nodes[unbalance]}"
        ),
    )


def _position(name: str, what: str, node: int, nodes: list[int]) -> int:
    """Index of a node in the list of all nodes."""
    if node not in nodes:
        raise PlantError(f"{name}: {what} has {node!r}; allowed: nodes {nodes[0]} to {nodes[-1]}")
    return nodes.index(node)


def _pair(name: str, what: str, pair: Sequence[int], nodes: list[int]) -> list[int]:
    if len(pair) != 2:
        raise PlantError(f"{name}: {what} = {list(pair)!r}; needed: two nodes, at A and at B")
    a, b = (_position(name, what, node, nodes) for node in pair)
    if a >= b:
        raise PlantError(f"{name}: {what} = {list(pair)!r}; A, the first, must be the node at smaller z")
    return [a, b]


def _in_both_planes(shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows for x and y of every node, columns for x and y of every mode."""
    return np.asarray(np.kron(shapes, np.eye(2)), dtype=np.float64)


def _pose(displacement: NDArray[np.float64], tilt: float = 0.0) -> NDArray[np.float64]:
    """Vector of one plane: displacements of all nodes, then their tilts."""
    return np.concatenate([displacement, np.full_like(displacement, tilt)])


def _plane(name: str, rotor: Any) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mass and stiffness of the plane of x (equal to those of y), and gyroscopic matrix from y' to forces on x."""
    first = rotor.number_dof * np.asarray(rotor.nodes)
    offset = rotor.shaft_elements[0].dof_mapping()
    lateral = np.concatenate([first + offset[f"{axis}_0"] for axis in ("x", "beta", "y", "alpha")])
    sign = np.repeat([1.0, 1.0, 1.0, -1.0], len(first))  # alpha is -dy/dz
    others = np.setdiff1d(np.arange(rotor.ndof), lateral)
    size = 2 * len(first)
    blocks = []
    for matrix, pattern in (("M0", np.eye(2)), ("K0", np.eye(2)), ("G0", _TURN)):
        full = np.asarray(getattr(rotor, matrix))
        planes = sign[:, None] * full[np.ix_(lateral, lateral)] * sign
        block = planes[:size, :size] if pattern[0, 0] else planes[:size, size:]
        deviation = np.abs(planes - np.kron(pattern, block)).max()
        coupling = np.abs(full[np.ix_(lateral, others)]).max(initial=0.0)
        if max(deviation, coupling) > _TOLERANCE * np.abs(planes).max():
            raise PlantError(
                f"{name}: its matrix {matrix} is not that of an axisymmetric shaft, which is alike along x and y and "
                "bends without axial motion and torsion"
            )
        blocks.append(block)
    mass, stiffness, gyroscopic = blocks
    return mass, stiffness, gyroscopic


def _rigid_modes(
    name: str, mass: NDArray[np.float64], stiffness: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Translation and tilt about the centre of mass, of unit modal mass, and the position of that centre (m)."""
    translation = _pose(np.ones_like(z))
    centre = float(translation @ mass @ _pose(z, 1.0) / (translation @ mass @ translation))
    poses = np.column_stack([translation, _pose(z - centre, 1.0)])
    if np.abs(stiffness @ poses).max() > _TOLERANCE * (np.abs(stiffness) @ np.abs(poses)).max():
        raise PlantError(f"{name}: something other than its bearings holds the shaft, which must be free to move")
    return poses / np.sqrt(np.sum(poses * (mass @ poses), axis=0)), centre


def _bending_modes(
    name: str, mass: NDArray[np.float64], stiffness: NDArray[np.float64], rigid: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Natural frequencies (rad/s) and modes of unit modal mass, moving the last node towards + ."""
    squares, modes = scipy.linalg.eigh(stiffness, mass, subset_by_index=[0, count + 2])
    if squares[2] < _GAP * np.abs(squares[:2]).max():
        raise PlantError(f"{name}: moves in more than two ways without bending; needed: one shaft without hinges")
    squares, modes = squares[2:-1], modes[:, 2:-1]
    modes -= rigid @ (rigid.T @ mass @ modes)  # remove rounding residues of the rigid body modes
    return np.sqrt(squares), modes * np.where(modes[len(modes) // 2 - 1] < 0.0, -1.0, 1.0)
