"""Parameters of the plant: power amplifiers, magnetic circuit, iron, sensors; with those of the rotor.

The declaration of each says whether the paper states its default, or another one, and where, or it is assumed
(`source`).
"""

from __future__ import annotations

import math
from typing import Literal

from pydantic import model_validator

from amb_core.ground.parameters import Parameters, choice, quantity, switch
from amb_core.plant.rotor_parameters import (
    BackupBearingParameters,
    FlexibleRotorParameters,
    RigidRotorParameters,
    RotorParameters,
)
from amb_core.plant.thrust_parameters import ThrustBearingParameters


class MagneticCircuitParameters(Parameters):
    """Eight-pole heteropolar stator and journal."""

    actuators: Literal["two_axis", "differential", "top_coil"] = choice(
        "two_axis",
        "electromagnets with an amplifier: all four (2-DOF), +y and -y (1-DOF differential), +y alone (1-DOF); "
        "with 1 DOF the rotor moves along y only",
        source="stated: section 2.4",
    )
    air_gap: float = quantity(
        0.6e-3, "m", "air gap between pole and journal, rotor centred", 1e-5, 1e-2, source="stated: table 1"
    )
    axial_length: float = quantity(49.15e-3, "m", "axial bearing length", 1e-3, 1.0, source="stated: table 1")
    journal_inner_radius: float = quantity(
        15.88e-3, "m", "journal inner radius r_r", 1e-3, 1.0, source="stated: table 1"
    )
    journal_outer_radius: float = quantity(
        34.95e-3, "m", "journal outer radius r_j", 1e-3, 1.0, source="stated: table 1"
    )
    pole_radius: float = quantity(35.60e-3, "m", "stator pole radius r_p", 1e-3, 1.0, source="stated: table 1")
    back_iron_inner_radius: float = quantity(
        60.00e-3, "m", "stator back-iron inner radius r_c", 1e-3, 1.0, source="stated: table 1"
    )
    stator_outer_radius: float = quantity(75.00e-3, "m", "stator outer radius r_s", 1e-3, 1.0, source="stated: table 1")
    pole_width: float = quantity(13.89e-3, "m", "pole width r_w", 1e-4, 1.0, source="stated: table 1")
    turns_per_pole: int = quantity(
        50,
        "-",
        "turns per pole; two poles in series make an electromagnet",
        1,
        10_000,
        source="stated: table 1, taken as per pole",
    )
    coil_resistance: float = quantity(
        0.2,
        "ohm",
        "resistance of the two coils of an electromagnet",
        0.0,
        100.0,
        source="stated: table 1, taken for both coils",
    )
    relative_permeability: float = quantity(
        4000.0, "-", "relative permeability of linear iron", 1.0, 1e12, source="stated: table 1"
    )
    lamination_thickness: float = quantity(0.35e-3, "m", "thickness of the laminations", 1e-5, 5e-3, source="assumed")
    iron_conductivity: float = quantity(
        2.0e6, "S/m", "conductivity of the iron, silicon steel", 1e3, 1e8, source="assumed"
    )
    coupling: bool = switch(
        True,
        "flux couples between the electromagnets; false: each closes its own circuit",
        source="stated: section 2.4",
    )

    @model_validator(mode="after")
    def _radii_ascend(self) -> MagneticCircuitParameters:
        radii = ("journal_inner_radius", "journal_outer_radius", "pole_radius", "back_iron_inner_radius")
        for smaller, larger in zip(radii, (*radii[1:], "stator_outer_radius"), strict=True):
            if getattr(self, smaller) >= getattr(self, larger):
                raise ValueError(
                    f"{smaller} = {getattr(self, smaller):g} m must be smaller than "
                    f"{larger} = {getattr(self, larger):g} m"
                )
        room = 2.0 * self.pole_radius * math.sin(math.pi / 8.0)
        if self.pole_width >= room:
            raise ValueError(
                f"pole_width = {self.pole_width:g} m lets neighbouring poles overlap; allowed: less than {room:.4g} m, "
                f"the distance of eight poles at pole_radius = {self.pole_radius:g} m"
            )
        return self


class IronParameters(Parameters):
    """Effects of the iron beyond its constant relative permeability; one material for poles, back iron and journal.

    Defaults of the Jiles-Atherton model are those of a non-oriented silicon steel in Gyselinck, Dular, Sadowski, Leite,
    Bastos, "Incorporation of a Jiles-Atherton vector hysteresis model in 2D FE magnetic field computations", COMPEL 23
    (2004): coercive field 36 A/m, remanence 0.67 T, largest relative permeability 8250, saturation at 1.44 T.
    """

    saturation: bool = switch(
        False,
        "flux density saturates along a curve; false: relative_permeability",
        source="against section 2.4, which has it, without values",
    )
    hysteresis: bool = switch(
        False,
        "flux density follows loops (Jiles-Atherton); needs saturation",
        source="against section 2.4, which has it, without values",
    )
    eddy_currents: bool = switch(True, "eddy currents in the laminations", source="stated: section 2.4")
    laminations: Literal["thin", "diffusion"] = choice(
        "thin",
        "eddy currents of laminations: thin, fast but with too much loss above some hundred hertz, or diffusion of the "
        "flux at relative_permeability, right to 1 MHz",
        source="assumed",
    )
    solid_journal: bool = switch(
        False, "journal of solid iron of constant permeability: flux lags as it diffuses", source="assumed"
    )
    saturation_magnetisation: float = quantity(
        1.14522e6, "A/m", "saturation magnetisation M_s", 1e4, 3e6, source="assumed"
    )
    anhysteretic_field: float = quantity(
        59.5, "A/m", "shape parameter a of the anhysteretic curve", 0.1, 1e5, source="assumed"
    )
    interdomain_coupling: float = quantity(1.3e-4, "-", "interdomain coupling alpha", 0.0, 1.0, source="assumed")
    pinning_field: float = quantity(99.2, "A/m", "pinning k", 0.1, 1e5, source="assumed")
    reversibility: float = quantity(0.54, "-", "reversible part c of the magnetisation", 0.0, 1.0, source="assumed")
    bh_table: str = choice(
        "",
        "CSV file with columns H (A/m) and B (T), from 0, 0 upwards, instead of the anhysteretic curve; "
        "empty for none; no hysteresis with it",
    )
    journal_conductivity: float = quantity(
        5.0e6, "S/m", "conductivity of a solid journal, steel", 1e3, 1e8, source="assumed"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> IronParameters:
        if self.hysteresis and not self.saturation:
            raise ValueError("hysteresis is on and saturation off; loops saturate: switch both on, or hysteresis off")
        if self.hysteresis and self.bh_table:
            raise ValueError(
                f"hysteresis is on with bh_table = '{self.bh_table}', which is a single curve; allowed with "
                "hysteresis: no table, but saturation_magnetisation and the other Jiles-Atherton parameters"
            )
        if self.bh_table and not self.saturation:
            raise ValueError(f"bh_table = '{self.bh_table}' is given and saturation is off; switch it on")
        return self


class AmplifierParameters(Parameters):
    """Two-state switched-mode power amplifier, one per electromagnet."""

    supply_voltage: float = quantity(
        300.0, "V", "supply voltage: a coil sees plus or minus this", 1.0, 5000.0, source="stated: table 1"
    )
    switching_frequency: float = quantity(100e3, "Hz", "switching frequency", 1e3, 1e6, source="stated: table 1")
    minimum_duty: float = quantity(0.25, "-", "smallest duty cycle", 0.0, 0.5, source="stated: section 2.4")
    maximum_duty: float = quantity(0.75, "-", "largest duty cycle", 0.5, 1.0, source="stated: section 2.4")
    proportional_gain: float = quantity(
        1.0, "1/A", "PI gain from current error to duty cycle, K_P", 0.0, 1e3, source="stated: table 1, unit assumed"
    )
    integral_gain: float = quantity(
        0.01, "1/(A s)", "PI integral gain K_I", 0.0, 1e6, source="stated: table 1, unit assumed"
    )
    bias_current: float = quantity(
        3.0, "A", "bias current of every electromagnet", 0.0, 100.0, source="stated: table 1"
    )
    current_limit: float = quantity(10.0, "A", "limit on the coil current reference", 0.0, 1000.0, source="assumed")
    switching: bool = switch(
        True, "resolve the pulse-width modulation; false: apply its average voltage", source="stated: section 2.4"
    )
    carriers: Literal["synchronous", "interleaved"] = choice(
        "synchronous",
        "switching periods of the electromagnets begin together, or each a quarter of a period later",
        source="assumed",
    )
    dead_time: float = quantity(
        0.0, "s", "delay of the edge that starts to drive the coil current", 0.0, 1e-5, source="assumed"
    )
    limits: bool = switch(
        True,
        "duty cycle and coil current reference are limited; false only without switching",
        source="stated: section 2.4, of the duty cycle; else assumed",
    )
    unipolar: bool = switch(True, "the coil current cannot become negative", source="assumed")

    @model_validator(mode="after")
    def _fits_together(self) -> AmplifierParameters:
        if self.switching and not self.limits:
            raise ValueError(
                "limits are off and switching is on; pulses have a duty cycle of 0 to 1: switch one of them"
            )
        if self.limits and self.bias_current > self.current_limit:
            raise ValueError(
                f"bias_current = {self.bias_current:g} A must not exceed current_limit = {self.current_limit:g} A"
            )
        longest = self.minimum_duty / self.switching_frequency
        if self.switching and self.dead_time > longest:
            raise ValueError(
                f"dead_time = {self.dead_time:g} s must not exceed the shortest pulse, minimum_duty / "
                f"switching_frequency = {longest:g} s"
            )
        return self


class SensorParameters(Parameters):
    """Position sensors; ideal by default."""

    bandwidth: float = quantity(
        0.0, "Hz", "first-order low-pass; 0 for none", 0.0, 1e6, source="stated: section 2.4, ideal"
    )
    noise: float = quantity(
        0.0, "m", "standard deviation of white noise on every sample", 0.0, 1e-3, source="stated: section 2.4, ideal"
    )
    noise_seed: int = quantity(0, "-", "seed of the noise: the same noise after every reset", 0, 2**31 - 1)


class ConverterParameters(Parameters):
    """Converters and computer between sensors and amplifiers; ideal by default."""

    position_resolution: float = quantity(
        0.0, "m", "step of the analogue-digital converter; 0 for none", 0.0, 1e-3, source="assumed"
    )
    current_resolution: float = quantity(
        0.0, "A", "step of the digital-analogue converter; 0 for none", 0.0, 10.0, source="assumed"
    )
    computation_delay: float = quantity(
        0.0,
        "-",
        "part of a controller sample until a control current reference takes effect",
        0.0,
        1.0,
        source="assumed",
    )


class IntegrationParameters(Parameters):
    """Time grid."""

    sample_rate: float = quantity(10_000.0, "Hz", "controller sample rate f_s", 1e3, 1e5, source="stated: section 3.2")
    internal_step: float = quantity(0.5e-6, "s", "step of the integrator", 1e-9, 1e-5)


class PlantParameters(Parameters):
    """The plant: control current references of all axes in, rotor positions out.

    With a rotor in two bearings, bearing B has a magnetic circuit and amplifiers like those of bearing A.
    """

    magnetic_circuit: MagneticCircuitParameters = MagneticCircuitParameters()
    iron: IronParameters = IronParameters()
    amplifier: AmplifierParameters = AmplifierParameters()
    rotor: RotorParameters = RotorParameters()
    rigid_rotor: RigidRotorParameters = RigidRotorParameters()
    flexible_rotor: FlexibleRotorParameters = FlexibleRotorParameters()
    thrust_bearing: ThrustBearingParameters = ThrustBearingParameters()
    backup_bearing: BackupBearingParameters = BackupBearingParameters()
    sensor: SensorParameters = SensorParameters()
    converters: ConverterParameters = ConverterParameters()
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
    def _periods_are_whole_steps(self) -> PlantParameters:
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
        if self.amplifier.carriers == "interleaved" and self.amplifier.switching and self.steps_per_period % 4 != 0:
            raise ValueError(
                f"amplifier.carriers = 'interleaved' shifts by a quarter of the switching period, which has "
                f"{self.steps_per_period} internal steps; allowed: a multiple of four"
            )
        return self

    @model_validator(mode="after")
    def _rotor_fits_the_bearing(self) -> PlantParameters:
        radius, gap = self.rotor.backup_bearing_radius, self.magnetic_circuit.air_gap
        if radius >= gap:
            raise ValueError(f"rotor.backup_bearing_radius = {radius:g} m must be smaller than the air gap, {gap:g} m")
        if (self.rotor.initial_x**2 + self.rotor.initial_y**2) ** 0.5 >= radius:
            raise ValueError(
                f"rotor.initial_x = {self.rotor.initial_x:g} m and initial_y = {self.rotor.initial_y:g} m must lie "
                f"inside the backup bearing, {radius:g} m"
            )
        if self.iron.solid_journal and not self.iron.eddy_currents:
            raise ValueError("iron.solid_journal is on and iron.eddy_currents off; its lag is eddy currents")
        if self.iron.laminations == "diffusion" and not self.iron.eddy_currents:
            raise ValueError(
                "iron.laminations = 'diffusion' and iron.eddy_currents is off; flux diffuses against eddy currents: "
                "switch them on, or iron.laminations: thin"
            )
        return self

    @model_validator(mode="after")
    def _disc_fits_the_thrust_bearing(self) -> PlantParameters:
        rotor, clearance = self.rotor, self.thrust_bearing.clearance
        if not rotor.axial:
            for name in ("external_force_z", "initial_z"):
                if getattr(rotor, name) != 0.0:
                    raise ValueError(f"rotor.{name} is given and rotor.axial is off; switch it on")
            return self
        if self.magnetic_circuit.actuators != "two_axis":
            raise ValueError(
                f"rotor.axial is on with magnetic_circuit.actuators = '{self.magnetic_circuit.actuators}'; allowed "
                "with a thrust bearing: two_axis"
            )
        if abs(rotor.initial_z) >= clearance:
            raise ValueError(
                f"rotor.initial_z = {rotor.initial_z:g} m must lie inside the axial backup bearing, {clearance:g} m"
            )
        return self

    @model_validator(mode="after")
    def _rotor_has_what_it_needs(self) -> PlantParameters:
        if self.rotor.model == "flexible" and not self.flexible_rotor.modal_data:
            raise ValueError("rotor.model = 'flexible' needs flexible_rotor.modal_data, a file of modal data")
        if self.rotor.model != "point_mass" and self.magnetic_circuit.actuators != "two_axis":
            raise ValueError(
                f"rotor.model = '{self.rotor.model}' moves along x and y; magnetic_circuit.actuators = "
                f"'{self.magnetic_circuit.actuators}' pull along y only; allowed: two_axis"
            )
        return self
