"""Parameters of the rotor and of the backup bearings that catch it."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from amb_core.ground.parameters import Parameters, choice, quantity, switch
from amb_core.loop.bearing import BACKUP_BEARING_RADIUS


class RotorParameters(Parameters):
    """The rotor and what acts on it; displacements are those of the journals in their bearings."""

    model: Literal["point_mass", "rigid", "flexible"] = choice(
        "point_mass",
        "half a rotor in one bearing, or a rotor in two bearings A and B: rigid body (rigid_rotor) or modes "
        "(flexible_rotor)",
        source="stated: section 2.4",
    )
    mass: float = quantity(
        6.25,
        "kg",
        "point mass carried by the bearing: half of the rotor",
        1e-3,
        1e5,
        source="assumed: half of the 12.5 kg of table 1",
    )
    gravity: float = quantity(
        9.81,
        "m/s^2",
        "gravity along -y; 0 switches it off",
        0.0,
        100.0,
        source="stated: section 2.1, without its value",
    )
    running_speed: float = quantity(
        0.0,
        "Hz",
        "running speed from +x to +y, in revolutions per second (`running_speed` of the region monitor is in rad/s)",
        0.0,
        5000.0,
        source="stated: section 2.3",
    )
    unbalance: float = quantity(
        0.0,
        "kg m",
        "static unbalance, mass times eccentricity: at the centre of mass, or where the modal data have it",
        0.0,
        1.0,
    )
    external_force_x: float = quantity(0.0, "N", "external force on the rotor at bearing A, x axis", -1e6, 1e6)
    external_force_y: float = quantity(0.0, "N", "external force on the rotor at bearing A, y axis", -1e6, 1e6)
    external_force_frequency: float = quantity(
        0.0, "Hz", "frequency of the external force, a cosine starting at the reset; 0 for a constant force", 0.0, 1e5
    )
    backup_bearing_radius: float = quantity(
        BACKUP_BEARING_RADIUS,
        "m",
        "radial rotor displacement at which it touches the backup bearing",
        1e-6,
        1e-2,
        source="stated: table 1",
    )
    initial_x: float = quantity(0.0, "m", "rotor position at reset, x axis", -1e-2, 1e-2)
    initial_y: float = quantity(0.0, "m", "rotor position at reset, y axis", -1e-2, 1e-2)
    axial: bool = switch(False, "the rotor moves along its axis too, axis z, in a thrust bearing (thrust_bearing)")
    external_force_z: float = quantity(0.0, "N", "external force on the rotor along its axis, z", -1e6, 1e6)
    initial_z: float = quantity(0.0, "m", "rotor position at reset, z axis", -1e-2, 1e-2)

    @property
    def constant_force(self) -> tuple[float, float, float]:
        """External force along x, y and z (N) that holds on at rest: none if it alternates."""
        if self.external_force_frequency != 0.0:
            return 0.0, 0.0, 0.0
        return self.external_force_x, self.external_force_y, self.external_force_z


class RigidRotorParameters(Parameters):
    """Rigid rotor in two bearings, for `rotor.model: rigid`. Axial positions count from the centre of mass."""

    mass: float = quantity(12.5, "kg", "mass of the rotor", 1e-3, 1e5, source="stated: table 1")
    transverse_inertia: float = quantity(
        0.25, "kg m^2", "moment of inertia about a diameter", 1e-9, 1e6, source="assumed"
    )
    polar_inertia: float = quantity(0.008, "kg m^2", "moment of inertia about the axis", 0.0, 1e6, source="assumed")
    bearing_a: float = quantity(-0.15, "m", "axial position of bearing A", -10.0, 10.0, source="assumed")
    bearing_b: float = quantity(0.15, "m", "axial position of bearing B", -10.0, 10.0, source="assumed")
    sensor_a: float = quantity(-0.15, "m", "axial position of the sensors of bearing A", -10.0, 10.0, source="assumed")
    sensor_b: float = quantity(0.15, "m", "axial position of the sensors of bearing B", -10.0, 10.0, source="assumed")

    @model_validator(mode="after")
    def _fits_together(self) -> RigidRotorParameters:
        for name in ("bearing", "sensor"):
            a, b = getattr(self, f"{name}_a"), getattr(self, f"{name}_b")
            if a >= b:
                raise ValueError(f"{name}_a = {a:g} m must be smaller than {name}_b = {b:g} m: A is the side of -z")
        if self.polar_inertia > 2.0 * self.transverse_inertia:
            raise ValueError(
                f"polar_inertia = {self.polar_inertia:g} kg m^2 of a body cannot exceed twice its transverse_inertia, "
                f"{2.0 * self.transverse_inertia:g} kg m^2"
            )
        return self


class FlexibleRotorParameters(Parameters):
    """Flexible rotor in two bearings, for `rotor.model: flexible`."""

    modal_data: str = choice(
        "",
        "file of modal data (.npz), see amb_core.plant.modal_data; package://NAME/PATH for one of a built package",
    )


class BackupBearingParameters(Parameters):
    """Contact of the rotor with the backup bearing; its radius is `rotor.backup_bearing_radius`."""

    contact: bool = switch(
        False, "the rotor bounces and rubs on the backup bearing; false: touching it ends the run", source="assumed"
    )
    stiffness: float = quantity(2e7, "N/m", "contact stiffness", 1e3, 1e10, source="assumed")
    damping: float = quantity(2e3, "N s/m", "contact damping", 0.0, 1e7, source="assumed")
    friction: float = quantity(
        0.1, "-", "friction coefficient against the surface of the turning rotor", 0.0, 2.0, source="assumed"
    )
