"""The orbit of a mode in the sensor planes: whether it turns with the rotor, against it, or moves along a line.

In a plane with the complex displacements X and Y of a mode of rate s = sigma + j omega, omega > 0, the orbit is

    q(t) = Re(X e^{st}) + j Re(Y e^{st}) = e^{sigma t} (q_f e^{j omega t} + q_b e^{-j omega t}),

with q_f = (X + jY) / 2 and |q_b| = |X - jY| / 2: a circle that turns from +x to +y, as the rotor does, and one that
turns against it. Their sum and difference are the half axes of an ellipse, which the larger circle leads around.

Sources: Muszynska, "Rotordynamics", CRC Press 2005, ch. 2; ISO 1925 (forward and backward whirl); C.-W. Lee, "Vibration
Analysis of Rotors", Kluwer 1993, ch. 2 (directional coordinates).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Whirl = Literal["forward", "backward", "planar", "mixed", "none"]
"""`mixed`: forward in one plane and backward in another. `none`: a mode that does not oscillate, or has no orbit."""

PLANAR = 0.05
"""Ratio of the short to the long half axis of an orbit below which it counts as a line."""
AT_REST = 0.05
"""Displacement in a plane, over the largest of all planes, below which the plane is a node without orbit."""


@dataclass(frozen=True)
class SensorPlane:
    """A plane with two sensors: its name, empty for the only one, and the outputs along x and y."""

    name: str
    x: int
    y: int


def sensor_planes(outputs: Sequence[str]) -> tuple[SensorPlane, ...]:
    """The sensor planes among outputs named x and y, or x_a and y_a, x_b and y_b, in their order; others have none."""
    names = list(outputs)
    planes = []
    for number, name in enumerate(names):
        if (name == "x" or name.startswith("x_")) and f"y{name[1:]}" in names:
            planes.append(SensorPlane(name[2:], number, names.index(f"y{name[1:]}")))
    return tuple(planes)


def ellipticity(shape: NDArray[np.complex128], plane: SensorPlane) -> float:
    """Short over long half axis of the orbit in a plane: 1 forward circle, 0 line, -1 backward circle, 0 at rest.

    Parameters
    ----------
    shape : ndarray, shape (p,)
        Complex displacements at the outputs, of the pole with positive imaginary part.
    plane : SensorPlane
        The plane.
    """
    forward = abs(shape[plane.x] + 1j * shape[plane.y])
    backward = abs(shape[plane.x] - 1j * shape[plane.y])
    total = forward + backward
    return float((forward - backward) / total) if total > 0.0 else 0.0


def whirl_of(shape: NDArray[np.complex128], planes: Sequence[SensorPlane]) -> Whirl:
    """Direction in which an oscillating mode whirls, from its orbits in all planes that are no node.

    Parameters
    ----------
    shape : ndarray, shape (p,)
        Complex displacements at the outputs, of the pole with positive imaginary part.
    planes : sequence of SensorPlane
        The planes; without any there is no whirl.
    """
    sizes = np.array([np.linalg.norm(shape[[plane.x, plane.y]]) for plane in planes])
    if not len(sizes) or sizes.max() < AT_REST * np.abs(shape).max():
        return "none"
    moving = [plane for plane, size in zip(planes, sizes, strict=True) if size >= AT_REST * sizes.max()]
    turns = {int(np.sign(value)) for value in (ellipticity(shape, plane) for plane in moving) if abs(value) >= PLANAR}
    if not turns:
        return "planar"
    return "mixed" if len(turns) == 2 else "forward" if turns == {1} else "backward"


def in_phase(shape: NDArray[np.complex128], first: SensorPlane, second: SensorPlane) -> float:
    """Cosine between the displacements of two planes: 1 for a translation, -1 for a tilt about the middle."""
    a, b = shape[[first.x, first.y]], shape[[second.x, second.y]]
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return float(np.vdot(a, b).real / size) if size > 0.0 else 0.0
