"""Rotors in two bearings: the matrices of their equation of motion.

    M q'' + (D + G) q' + K q = B^T f + U^T f_u + w

with bearing forces f at A x, A y, B x, B y, force f_u of the unbalance, weight w; journals are at B q, sensors measure
S q. Axes are x (horizontal), y (up), z (along the shaft, bearing A at smaller z than B); the rotor turns from +x to +y.
Damping is that of the surroundings, D q' in the fixed frame; damping inside a turning rotor is not modelled.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 7 (rigid) and 10 (flexible); Genta,
"Dynamics of Rotating Systems", Springer 2005.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.modal_data import ModalData
from amb_core.plant.parameters import PlantParameters


@dataclass(frozen=True, eq=False)
class RotorModel:
    """A rotor in two bearings with n generalised coordinates q, at one running speed.

    Attributes
    ----------
    coordinate_names : tuple of str
        Names of the coordinates.
    mass, damping, stiffness : ndarray, shape (n, n)
        M, D and K, symmetric; in kg, N s/m and N/m for coordinates in m.
    gyroscopic : ndarray, shape (n, n)
        G at the running speed, skew; units of the damping.
    bearings, sensors : ndarray, shape (4, n)
        B and S: displacement of the journals, and at their sensors, at A x, A y, B x, B y per coordinate.
    unbalance : ndarray, shape (2, n)
        U: displacement in the plane of the unbalance, x and y, per coordinate.
    weight : ndarray, shape (n,)
        w: generalised force of gravity; in N for coordinates in m.
    """

    coordinate_names: tuple[str, ...]
    mass: NDArray[np.float64]
    damping: NDArray[np.float64]
    gyroscopic: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    bearings: NDArray[np.float64]
    sensors: NDArray[np.float64]
    unbalance: NDArray[np.float64]
    weight: NDArray[np.float64]

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.mass)

    def coordinates_at(self, x: float, y: float) -> NDArray[np.float64]:
        """Coordinates, shape (n,), with both journals at x, y (m): the pose with the least strain energy."""
        return self.pose([x, y, x, y])

    def pose(self, journals: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates, shape (n,), with the journals at A x, A y, B x, B y (m) and the least strain energy."""
        # Stationary point of q^T K q / 2 + lambda^T (B q - target); scaling K does not change it.
        scale = max(float(np.abs(self.stiffness).max()), np.finfo(np.float64).tiny)
        system = np.block([[self.stiffness / scale, self.bearings.T], [self.bearings, np.zeros((4, 4))]])
        target = np.concatenate([np.zeros(self.n), journals])
        return np.linalg.lstsq(system, target, rcond=None)[0][: self.n]

    def poles(self, bearing_stiffness: float | NDArray[np.float64] = 0.0) -> NDArray[np.complex128]:
        """Poles (1/s), shape (2n,), of the rotor on springs in the bearings.

        Parameters
        ----------
        bearing_stiffness : float or ndarray, shape (4,)
            Stiffness of the springs (N/m), the same for all or at A x, A y, B x, B y; 0 for the free rotor.
        """
        springs = np.broadcast_to(bearing_stiffness, 4)
        stiffness = self.stiffness + (self.bearings.T * springs) @ self.bearings
        rates = np.linalg.solve(self.mass, -np.hstack([stiffness, self.damping + self.gyroscopic]))
        return np.linalg.eigvals(np.vstack([np.eye(self.n, 2 * self.n, k=self.n), rates]))

    def natural_frequencies(self, bearing_stiffness: float | NDArray[np.float64] = 0.0) -> NDArray[np.float64]:
        """Frequencies of vibration on springs (N/m, see `poles`), ascending (Hz), shape (n,); 0 for none."""
        # Poles come in pairs of equal magnitude of the imaginary part: conjugate ones, or two real ones.
        return np.sort(np.abs(self.poles(bearing_stiffness).imag))[::2] / (2.0 * np.pi)


def rotor_model(parameters: PlantParameters) -> RotorModel:
    """The rotor in two bearings selected by `rotor.model`, `rigid` or `flexible`.

    Raises
    ------
    PlantError
        If the file of modal data of a flexible rotor is refused.
    """
    return rigid_rotor(parameters) if parameters.rotor.model == "rigid" else flexible_rotor(parameters)


def rotor_mass(parameters: PlantParameters, rotor: RotorModel | None) -> float:
    """Mass that moves in a rigid translation (kg): the point mass where there is no rotor in two bearings."""
    if rotor is None:
        return parameters.rotor.mass
    lifted = rotor.coordinates_at(0.0, 1.0)
    return float(lifted @ rotor.mass @ lifted)


def contact_mass(parameters: PlantParameters, rotor: RotorModel | None) -> float:
    """Least mass that a force on the journals moves (kg): the point mass where there is no rotor in two bearings."""
    if rotor is None:
        return parameters.rotor.mass
    by_force = rotor.bearings @ np.linalg.solve(rotor.mass, rotor.bearings.T)
    return float(1.0 / np.linalg.eigvalsh(by_force).max())


def journal_loads(parameters: PlantParameters, rotor: RotorModel | None) -> NDArray[np.float64]:
    """Weight and constant external force that rest on the bearings (N), shape (2 * bearings,): x, y of each."""
    loads = np.zeros(2 if rotor is None else 4)
    loads[1::2] = (
        -parameters.rotor.mass * parameters.rotor.gravity
        if rotor is None
        else [rotor.pose(lifted) @ rotor.weight for lifted in np.eye(4)[1::2]]
    )
    loads[:2] += parameters.rotor.constant_force[:2]
    return loads


def rigid_rotor(parameters: PlantParameters) -> RotorModel:
    """Rigid body; coordinates are x, y of its centre of mass and tilts dx/dz, dy/dz of its axis.

    The angular momentum I_p Omega along the tilting axis gives the gyroscopic moments I_t tilt_x'' + I_p Omega tilt_y'
    and I_t tilt_y'' - I_p Omega tilt_x': the free rotor nutates forward, from +x to +y, at I_p / I_t Omega.
    """
    rotor, body = parameters.rotor, parameters.rigid_rotor
    moment = body.polar_inertia * 2.0 * np.pi * rotor.running_speed
    gyroscopic = np.zeros((4, 4))
    gyroscopic[2, 3], gyroscopic[3, 2] = moment, -moment
    return RotorModel(
        coordinate_names=("x", "y", "tilt_x", "tilt_y"),
        mass=np.diag([body.mass, body.mass, body.transverse_inertia, body.transverse_inertia]),
        damping=np.zeros((4, 4)),
        gyroscopic=gyroscopic,
        stiffness=np.zeros((4, 4)),
        bearings=_rigid_displacement(body.bearing_a, body.bearing_b),
        sensors=_rigid_displacement(body.sensor_a, body.sensor_b),
        unbalance=_rigid_displacement(0.0),
        weight=np.array([0.0, -body.mass * rotor.gravity, 0.0, 0.0]),
    )


def flexible_rotor(parameters: PlantParameters) -> RotorModel:
    """Rotor of modes read from the file `flexible_rotor.modal_data`.

    Raises
    ------
    PlantError
        If the file is refused.
    """
    data = ModalData.load(parameters.flexible_rotor.modal_data)
    return modal_rotor(data, parameters.rotor.gravity, parameters.rotor.running_speed)


def modal_rotor(data: ModalData, gravity: float, running_speed: float) -> RotorModel:
    """Rotor of given modes, in modal coordinates (m sqrt(kg)).

    Parameters
    ----------
    data : ModalData
        The modes.
    gravity : float
        Gravity along -y (m/s^2).
    running_speed : float
        Revolutions per second from +x to +y (Hz).
    """
    rates = 2.0 * np.pi * data.natural_frequencies
    return RotorModel(
        coordinate_names=tuple(f"mode_{number}" for number in range(1, data.modes + 1)),
        mass=np.eye(data.modes),
        damping=np.diag(2.0 * data.damping_ratios * rates),
        gyroscopic=2.0 * np.pi * running_speed * 0.5 * (data.gyroscopic - data.gyroscopic.T),
        stiffness=np.diag(rates**2),
        bearings=data.bearings,
        sensors=data.sensors,
        unbalance=data.unbalance,
        weight=gravity * data.weight,
    )


def _rigid_displacement(*positions: float) -> NDArray[np.float64]:
    """Displacements along x and y at axial positions (m) per coordinate of the rigid rotor."""
    return np.vstack([[[1.0, 0.0, z, 0.0], [0.0, 1.0, 0.0, z]] for z in positions])
