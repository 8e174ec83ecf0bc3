"""Parameters of the plant: power amplifiers, magnetic circuit and rotor. Defaults are the paper's table 1.

What the table leaves open is marked "assumed" in its description.
"""

from __future__ import annotations

from pydantic import model_validator

from amb_core.parameters import Parameters, quantity, switch


class MagneticCircuitParameters(Parameters):
    """Eight-pole heteropolar stator and journal, linear iron."""

    air_gap: float = quantity(0.6e-3, "m", "air gap between pole and journal, rotor centred", 1e-5, 1e-2)
    axial_length: float = quantity(49.15e-3, "m", "axial bearing length", 1e-3, 1.0)
    journal_inner_radius: float = quantity(15.88e-3, "m", "journal inner radius r_r", 1e-3, 1.0)
    journal_outer_radius: float = quantity(34.95e-3, "m", "journal outer radius r_j", 1e-3, 1.0)
    pole_radius: float = quantity(35.60e-3, "m", "stator pole radius r_p", 1e-3, 1.0)
    back_iron_inner_radius: float = quantity(60.00e-3, "m", "stator back-iron inner radius r_c", 1e-3, 1.0)
    stator_outer_radius: float = quantity(75.00e-3, "m", "stator outer radius r_s", 1e-3, 1.0)
    pole_width: float = quantity(13.89e-3, "m", "pole width r_w", 1e-4, 1.0)
    turns_per_pole: int = quantity(50, "-", "turns per pole; two poles in series make an electromagnet", 1, 10_000)
    coil_resistance: float = quantity(0.2, "ohm", "resistance of the two coils of an electromagnet", 0.0, 100.0)
    relative_permeability: float = quantity(4000.0, "-", "relative permeability of linear iron", 1.0, 1e12)
    lamination_thickness: float = quantity(0.35e-3, "m", "thickness of the laminations (assumed)", 1e-5, 5e-3)
    iron_conductivity: float = quantity(2.0e6, "S/m", "conductivity of the iron (assumed, silicon steel)", 1e3, 1e8)
    coupling: bool = switch(True, "flux couples between the electromagnets; false: each closes its own circuit")

    @model_validator(mode="after")
    def _radii_ascend(self) -> MagneticCircuitParameters:
        radii = ("journal_inner_radius", "journal_outer_radius", "pole_radius", "back_iron_inner_radius")
        for smaller, larger in zip(radii, (*radii[1:], "stator_outer_radius"), strict=True):
            if getattr(self, smaller) >= getattr(self, larger):
                raise ValueError(
                    f"{smaller} = {getattr(self, smaller):g} m must be smaller than "
                    f"{larger} = {getattr(self, larger):g} m"
                )
        return self


class AmplifierParameters(Parameters):
    """Two-state switched-mode power amplifier, one per electromagnet."""

    supply_voltage: float = quantity(300.0, "V", "supply voltage: a coil sees plus or minus this", 1.0, 5000.0)
    switching_frequency: float = quantity(100e3, "Hz", "switching frequency", 1e3, 1e6)
    minimum_duty: float = quantity(0.25, "-", "smallest duty cycle", 0.0, 0.5)
    maximum_duty: float = quantity(0.75, "-", "largest duty cycle", 0.5, 1.0)
    proportional_gain: float = quantity(1.0, "1/A", "PI gain from current error to duty cycle, K_P", 0.0, 1e3)
    integral_gain: float = quantity(0.01, "1/(A s)", "PI integral gain K_I", 0.0, 1e6)
    bias_current: float = quantity(3.0, "A", "bias current of every electromagnet", 0.0, 100.0)
    current_limit: float = quantity(10.0, "A", "limit on the coil current reference (assumed)", 0.0, 1000.0)
    switching: bool = switch(True, "resolve the pulse-width modulation; false: apply its average voltage")
    unipolar: bool = switch(True, "the coil current cannot become negative")


class RotorParameters(Parameters):
    """Point-mass rotor in the bearing plane."""

    mass: float = quantity(6.25, "kg", "mass carried by the bearing: half of the rotor", 1e-3, 1e5)
    gravity: float = quantity(9.81, "m/s^2", "gravity along -y; 0 switches it off", 0.0, 100.0)
    backup_bearing_radius: float = quantity(
        250e-6, "m", "radial rotor displacement at which it touches the backup bearing", 1e-6, 1e-2
    )
    initial_x: float = quantity(0.0, "m", "rotor position at reset, x axis", -1e-2, 1e-2)
    initial_y: float = quantity(0.0, "m", "rotor position at reset, y axis", -1e-2, 1e-2)


class IntegrationParameters(Parameters):
    """Time grid."""

    sample_rate: float = quantity(10_000.0, "Hz", "controller sample rate f_s", 1e3, 1e5)
    internal_step: float = quantity(0.5e-6, "s", "step of the integrator", 1e-9, 1e-5)


class PlantParameters(Parameters):
    """The plant: two control current references in, rotor position out."""

    magnetic_circuit: MagneticCircuitParameters = MagneticCircuitParameters()
    amplifier: AmplifierParameters = AmplifierParameters()
    rotor: RotorParameters = RotorParameters()
    integration: IntegrationParameters = IntegrationParameters()

    @property
    def steps_per_sample(self) -> int:
        """Internal steps per controller sample."""
        return round(1.0 / (self.integration.sample_rate * self.integration.internal_step))

    @property
    def steps_per_period(self) -> int:
        """Internal steps per period of the pulse-width modulation."""
        return round(1.0 / (self.amplifier.switching_frequency * self.integration.internal_step))

    @model_validator(mode="after")
    def _fits_together(self) -> PlantParameters:
        step = self.integration.internal_step
        for name, frequency in (
            ("integration.sample_rate", self.integration.sample_rate),
            ("amplifier.switching_frequency", self.amplifier.switching_frequency),
        ):
            ratio = 1.0 / (frequency * step)
            if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6 * ratio:
                raise ValueError(
                    f"the period of {name} = {frequency:g} Hz must be a whole number of internal steps; "
                    f"integration.internal_step = {step:g} s goes {ratio:g} times into it"
                )
        radius, gap = self.rotor.backup_bearing_radius, self.magnetic_circuit.air_gap
        if radius >= gap:
            raise ValueError(f"rotor.backup_bearing_radius = {radius:g} m must be smaller than the air gap, {gap:g} m")
        if (self.rotor.initial_x**2 + self.rotor.initial_y**2) ** 0.5 >= radius:
            raise ValueError(
                f"rotor.initial_x = {self.rotor.initial_x:g} m and initial_y = {self.rotor.initial_y:g} m must lie "
                f"inside the backup bearing, {radius:g} m"
            )
        if self.amplifier.bias_current > self.amplifier.current_limit:
            raise ValueError(
                f"amplifier.bias_current = {self.amplifier.bias_current:g} A must not exceed "
                f"amplifier.current_limit = {self.amplifier.current_limit:g} A"
            )
        return self
