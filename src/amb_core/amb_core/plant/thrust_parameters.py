"""Parameters of the thrust bearing."""

from __future__ import annotations

from itertools import pairwise

from pydantic import model_validator

from amb_core.ground.parameters import Parameters, quantity, switch


class ThrustBearingParameters(Parameters):
    """Two opposed ring magnets around the shaft and a disc of solid steel between them, for `rotor.axial`.

    Each magnet has an inner and an outer ring pole with the coil in the slot between them. Its amplifier has the supply
    voltage, switching, duty limits and dead time of section `amplifier`; its carrier is synchronous.
    """

    inner_radius: float = quantity(
        22.0e-3, "m", "inner radius of the inner pole and of the disc", 1e-3, 1.0, source="assumed"
    )
    slot_inner_radius: float = quantity(32.0e-3, "m", "outer radius of the inner pole", 1e-3, 1.0, source="assumed")
    slot_outer_radius: float = quantity(46.0e-3, "m", "inner radius of the outer pole", 1e-3, 1.0, source="assumed")
    outer_radius: float = quantity(
        51.5e-3, "m", "outer radius of the outer pole and of the disc", 1e-3, 1.0, source="assumed"
    )
    slot_depth: float = quantity(25.0e-3, "m", "depth of the slot: length of the poles", 1e-4, 1.0, source="assumed")
    back_thickness: float = quantity(
        12.0e-3, "m", "thickness of the stator behind the slot", 1e-4, 1.0, source="assumed"
    )
    disc_thickness: float = quantity(16.0e-3, "m", "thickness of the thrust disc", 1e-4, 1.0, source="assumed")
    air_gap: float = quantity(0.5e-3, "m", "air gap of each magnet, disc centred", 1e-5, 1e-2, source="assumed")
    turns: int = quantity(100, "-", "turns of each coil", 1, 10_000, source="assumed")
    coil_resistance: float = quantity(0.5, "ohm", "resistance of each coil", 0.0, 100.0, source="assumed")
    relative_permeability: float = quantity(
        1000.0, "-", "relative permeability of the solid steel", 1.0, 1e6, source="assumed"
    )
    conductivity: float = quantity(5.0e6, "S/m", "conductivity of the solid steel", 1e3, 1e8, source="assumed")
    eddy_currents: bool = switch(
        True,
        "eddy currents in disc and stator: flux lags as the square root of the frequency",
        source="assumed",
    )
    bias_current: float = quantity(3.0, "A", "bias current of both coils", 1e-3, 100.0, source="assumed")
    current_limit: float = quantity(10.0, "A", "limit on the coil current references", 0.0, 1000.0, source="assumed")
    proportional_gain: float = quantity(
        0.2,
        "1/A",
        "PI gain of its amplifiers from current error to duty cycle",
        0.0,
        1e3,
        source="assumed",
    )
    integral_gain: float = quantity(10.0, "1/(A s)", "PI integral gain of its amplifiers", 0.0, 1e6, source="assumed")
    clearance: float = quantity(
        250e-6,
        "m",
        "axial rotor displacement at which it touches the backup bearing",
        1e-6,
        1e-2,
        source="assumed",
    )
    sensor_position: float = quantity(0.0, "m", "axial position of its sensor", -10.0, 10.0, source="assumed")
    actuator_position: float = quantity(0.0, "m", "axial position of the disc", -10.0, 10.0, source="assumed")

    @model_validator(mode="after")
    def _fits_together(self) -> ThrustBearingParameters:
        radii = ("inner_radius", "slot_inner_radius", "slot_outer_radius", "outer_radius")
        for smaller, larger in pairwise(radii):
            if getattr(self, smaller) >= getattr(self, larger):
                raise ValueError(
                    f"{smaller} = {getattr(self, smaller):g} m must be smaller than "
                    f"{larger} = {getattr(self, larger):g} m"
                )
        if self.bias_current > self.current_limit:
            raise ValueError(
                f"bias_current = {self.bias_current:g} A must not exceed current_limit = {self.current_limit:g} A"
            )
        if self.clearance >= self.air_gap:
            raise ValueError(f"clearance = {self.clearance:g} m must be smaller than air_gap = {self.air_gap:g} m")
        return self
