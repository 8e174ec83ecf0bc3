"""Description of a plant: the constants that characterise a bearing, derived from its parameters, and its effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from amb_core.ground.errors import PlantError
from amb_core.ground.given_values import require_kind
from amb_core.ground.parameters import SourcedValue, sourced_values
from amb_core.loop.control import ControllerParameters
from amb_core.plant.averaged import coil_references, flux_embedding
from amb_core.plant.linearise import linearize
from amb_core.plant.network import COIL_AXES, COIL_POLES, POLES, active_coils
from amb_core.plant.operating_point import static_force
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.plant import Plant
from amb_core.plant.switching_loss import switching_loss
from amb_core.plant.voltage import slew_voltage

_RELATIVE_STEP = 1e-5
"""Step of the central differences of the static force, over the air gap or 1 A."""


@dataclass(frozen=True)
class Entry:
    """One line of a description; `unit` is `-` for a pure number, `value` None where there is none."""

    name: str
    value: float | bool | None
    unit: str
    meaning: str


def _entry(meaning: str, unit: str = "-") -> Any:
    return field(metadata={"unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class PlantEffects:
    """Which effects the model of the plant has."""

    coupling: bool = _entry("the electromagnets share flux")
    linear_iron: bool = _entry("iron of constant permeability, without saturation and hysteresis")
    saturation: bool = _entry("the flux density in the iron saturates")
    hysteresis: bool = _entry("the iron has hysteresis loops (Jiles-Atherton)")
    eddy_currents: bool = _entry("eddy currents in laminations")
    lamination_diffusion: bool = _entry("flux diffuses into the laminations; otherwise they count as thin")
    solid_journal: bool = _entry("flux diffuses into a solid journal")
    switching: bool = _entry("pulse-width modulation is resolved, not averaged")
    interleaved_carriers: bool = _entry("the switching periods of the electromagnets follow one another")
    dead_time: bool = _entry("edges that drive a coil current are delayed")
    limits: bool = _entry("duty cycles and coil current references are limited")
    unipolar: bool = _entry("coil currents cannot become negative")
    gravity: bool = _entry("weight of the rotor along -y")
    two_bearings: bool = _entry("the rotor runs in two bearings")
    gyroscopic: bool = _entry("the rotor turns, with gyroscopic moments")
    flexible_rotor: bool = _entry("the rotor bends")
    unbalance: bool = _entry("static unbalance of the turning rotor")
    external_force: bool = _entry("external force on the rotor")
    contact: bool = _entry("the rotor bounces and rubs on the backup bearing")
    thrust_bearing: bool = _entry("the rotor moves along its axis in a thrust bearing")
    sensor_bandwidth: bool = _entry("first-order low-pass of the sensors")
    sensor_noise: bool = _entry("noise of the sensors")
    quantisation: bool = _entry("converters of positions or currents have finite steps")
    computation_delay: bool = _entry("current references take effect after a delay")

    @property
    def entries(self) -> list[Entry]:
        """The effects with their meanings."""
        return _entries(self)


@dataclass(frozen=True)
class PlantDescription:
    """Derived constants of a bearing and of its loop; the meaning of each is in its declaration.

    Constants of the bearing are those of the centred rotor at bias current; those of the loop belong to the operating
    point where the controller holds the rotor, those of the sampled loop with the sampling of the modulation. They are
    given along x, for a bearing with 1 DOF along y, and for two bearings of bearing A; those of a thrust bearing end in
    `_z`. None where there is no such number: the rigid mode of a loop in which rotor and amplifiers swing together, the
    sensitivity of an unstable one, z without a thrust bearing.

    Attributes
    ----------
    effects : PlantEffects, optional
        Which effects the model of the plant has.
    """

    current_gain: float = _entry("k_i: force per control current", "N/A")
    negative_stiffness: float = _entry("k_s: force per displacement, away from the centre", "N/m")
    coil_inductance: float = _entry("L0: self-inductance of an electromagnet", "H")
    bias_flux_density: float = _entry("mean flux density in the air gaps", "T")
    slew_rate: float | None = _entry("change of a coil current: the voltage that its resistance leaves, over L0", "A/s")
    eddy_time_constant: float = _entry("longest lag of the flux behind the coil currents", "s")
    switching_loss: float = _entry("eddy-current loss by the switching, as the laminations are modelled", "W")
    switching_loss_diffusion: float = _entry("the same with iron.laminations: diffusion, without its error", "W")
    peak_force: float = _entry("force along an axis at the limit of the control current", "N")
    sag: float = _entry("distance at which the rotor hangs below its reference", "m")
    unstable_pole: float = _entry("fastest unstable pole of the plant", "1/s")
    natural_frequency_x: float | None = _entry("natural frequency of the rigid rotor in the loop along x", "Hz")
    natural_frequency_y: float | None = _entry("natural frequency of the rigid rotor in the loop along y", "Hz")
    damping_ratio_x: float | None = _entry("damping ratio of the rigid rotor in the loop along x; from 1 on overdamped")
    damping_ratio_y: float | None = _entry("damping ratio of the rigid rotor in the loop along y; from 1 on overdamped")
    peak_sensitivity: float | None = _entry("largest gain from disturbed to measured position")
    stable: bool = _entry("small motions in the loop decay")
    current_gain_z: float | None = _entry("k_i of the thrust bearing at low frequency", "N/A")
    negative_stiffness_z: float | None = _entry("k_s of the thrust bearing", "N/m")
    eddy_corner_z: float | None = _entry("1 / (2 pi tau): both parts of the thrust bearing's reluctance alike", "Hz")
    effects: PlantEffects = field(kw_only=True)

    @property
    def entries(self) -> list[Entry]:
        """The constants with units and meanings."""
        return _entries(self)


def describe(parameters: PlantParameters, controller: ControllerParameters | None = None) -> PlantDescription:
    """Derive the constants of a bearing.

    Parameters
    ----------
    parameters : PlantParameters
        The plant.
    controller : ControllerParameters, optional
        The controller of its loop, by default the paper's gains at the plant's sample rate.

    Returns
    -------
    PlantDescription
        The constants of bearing and loop.

    Raises
    ------
    PlantError
        If the plant cannot be built, the controller cannot hold the rotor, or their sample rates differ.
    """
    require_kind("parameters", parameters, PlantParameters, "PlantParameters", PlantError)
    plant = Plant(parameters)
    controller = controller or ControllerParameters(sample_rate=parameters.integration.sample_rate)
    model = linearize(plant, controller)
    along_x, along_y = (model.rigid_mode(name) for name in plant.machine.axis_names[:2])
    circuit, amplifier = parameters.magnetic_circuit, parameters.amplifier
    inductance = _coil_inductance(plant)
    slewing = slew_voltage(parameters, model.point.current_reference[:2])
    bias_flux = plant.static_flux(plant.bias_currents(), 0.0, 0.0)
    poles = [pole for coil in active_coils(circuit) for pole in COIL_POLES[coil]]
    return PlantDescription(
        current_gain=_slope(lambda current: _force(plant, current, 0.0), 1.0),
        negative_stiffness=_slope(lambda displacement: _force(plant, 0.0, displacement), circuit.air_gap),
        coil_inductance=inductance,
        bias_flux_density=float(np.abs(bias_flux[poles]).mean() / plant.network.pole_area),
        slew_rate=slewing / inductance if amplifier.limits else None,
        eddy_time_constant=_eddy_time_constant(plant),
        switching_loss=switching_loss(parameters),
        switching_loss_diffusion=switching_loss(_with_diffusion(parameters)),
        peak_force=_peak_force(plant, controller),
        sag=float(controller.references(len(plant.machine.axes))[1] - model.point.position[1]),
        unstable_pole=float(model.continuous.poles().real.max()),
        natural_frequency_x=along_x.natural_hz if along_x else None,
        natural_frequency_y=along_y.natural_hz if along_y else None,
        damping_ratio_x=along_x.damping_ratio if along_x else None,
        damping_ratio_y=along_y.damping_ratio if along_y else None,
        peak_sensitivity=model.peak_sensitivity if model.stable else None,
        stable=model.stable,
        **_constants_of_axis(plant),
        effects=_effects(plant),
    )


def values_with_sources(parameters: PlantParameters, controller: ControllerParameters) -> list[SourcedValue]:
    """Values of a plant and its controller, stated by the paper, assumed or against it, without absent parts.

    Parameters
    ----------
    parameters : PlantParameters
        The plant.
    controller : ControllerParameters
        The controller; the names of its values begin with `controller.`.
    """
    rotor = parameters.rotor
    absent = {"rigid_rotor": rotor.model != "rigid", "thrust_bearing": not rotor.axial}
    own = [one for one in sourced_values(parameters) if not absent.get(one.name.split(".")[0])]
    return own + [replace(one, name=f"controller.{one.name}") for one in sourced_values(controller)]


def _constants_of_axis(plant: Plant) -> dict[str, float | None]:
    """Constants of the thrust bearing."""
    if plant.axial is None:
        return dict.fromkeys(("current_gain_z", "negative_stiffness_z", "eddy_corner_z"))
    circuit, bias = plant.axial.circuit, plant.parameters.thrust_bearing.bias_current
    return {
        "current_gain_z": circuit.current_gain(bias),
        "negative_stiffness_z": circuit.negative_stiffness(bias),
        "eddy_corner_z": 1.0 / (2.0 * np.pi * circuit.lag) if circuit.lag else None,
    }


def _with_diffusion(parameters: PlantParameters) -> PlantParameters:
    """The same plant with diffusion into its laminations, for closed forms."""
    iron = parameters.iron.model_copy(update={"laminations": "diffusion", "eddy_currents": True})
    return parameters.model_copy(update={"iron": iron})


def _effects(plant: Plant) -> PlantEffects:
    parameters = plant.parameters
    iron, amplifier, rotor = parameters.iron, parameters.amplifier, parameters.rotor
    sensor, converters = parameters.sensor, parameters.converters
    turning = rotor.running_speed > 0.0
    return PlantEffects(
        coupling=parameters.magnetic_circuit.coupling,
        linear_iron=not iron.saturation,
        saturation=iron.saturation,
        hysteresis=iron.hysteresis,
        eddy_currents=iron.eddy_currents,
        lamination_diffusion=iron.laminations == "diffusion",
        solid_journal=iron.solid_journal,
        switching=amplifier.switching,
        interleaved_carriers=amplifier.carriers == "interleaved" and amplifier.switching,
        dead_time=amplifier.dead_time > 0.0,
        limits=amplifier.limits,
        unipolar=amplifier.unipolar,
        gravity=rotor.gravity > 0.0,
        two_bearings=plant.bearings == 2,
        gyroscopic=turning and plant.rotor is not None and bool(plant.rotor.gyroscopic.any()),
        flexible_rotor=rotor.model == "flexible",
        unbalance=turning and rotor.unbalance > 0.0,
        external_force=any((rotor.external_force_x, rotor.external_force_y, rotor.external_force_z)),
        contact=parameters.backup_bearing.contact,
        thrust_bearing=plant.axial is not None,
        sensor_bandwidth=sensor.bandwidth > 0.0,
        sensor_noise=sensor.noise > 0.0,
        quantisation=converters.position_resolution > 0.0 or converters.current_resolution > 0.0,
        computation_delay=converters.computation_delay > 0.0,
    )


def _entries(description: PlantEffects | PlantDescription) -> list[Entry]:
    return [
        Entry(item.name, getattr(description, item.name), **item.metadata)
        for item in fields(description)
        if item.metadata
    ]


def _slope(function: Callable[[float], float], scale: float) -> float:
    """Derivative at zero by the central difference."""
    step = _RELATIVE_STEP * scale
    return (function(step) - function(-step)) / (2.0 * step)


def _axis(plant: Plant) -> int:
    """Axis along which constants are given: x, or y for a bearing with 1 DOF."""
    return "xy".index(plant.axes[0])


def _force(plant: Plant, control_current: float, displacement: float) -> float:
    """Static force along the axis (N) of a control current (A), unlimited, at a rotor displacement (m) along it."""
    axis = _axis(plant)
    active = plant.bias_currents() > 0.0
    position = np.zeros(2)
    position[axis] = displacement
    currents = plant.bias_currents() + active * COIL_AXES[:, axis] * control_current
    return float(static_force(plant, currents, position)[axis])


def _peak_force(plant: Plant, controller: ControllerParameters) -> float:
    axis = _axis(plant)
    control_current = np.zeros(2)
    control_current[axis] = controller.current_limit
    return float(static_force(plant, coil_references(control_current, plant), np.zeros(2))[axis])


def _coil_inductance(plant: Plant) -> float:
    """Of small changes about the bias currents."""
    coil = active_coils(plant.parameters.magnetic_circuit)[0]

    def linkage(change: float) -> float:
        currents = plant.bias_currents()
        currents[coil] += change
        return float(plant.network.winding[:, coil] @ plant.static_flux(currents, 0.0, 0.0))

    return _slope(linkage, 1.0)


def _eddy_time_constant(plant: Plant) -> float:
    """Longest time constant of K dphi/dt + (diag(g_j / (mu_0 A)) + R) phi = N_p S i + potentials, i constant."""
    from scipy.linalg import eigh

    _, fluxes = flux_embedding(plant)
    eddy = plant.network.eddy_coefficient
    if not eddy.any():
        return 0.0
    if plant.parameters.iron.laminations == "diffusion":  # slow fluxes: c s / (s + p) ~ s c / p
        laminated = plant.network.diffusing[0]
        eddy = eddy + float(np.sum(laminated.terms.weights / laminated.terms.rates)) * laminated.reluctance
    bias = plant.magnetostatics.solve(plant.bias_currents(), 0.0, 0.0)
    reluctance = plant.magnetostatics.differential_reluctance(bias.flux, bias.circulating, 0.0, 0.0)[:POLES, :POLES]
    return float(eigh(fluxes.T @ eddy @ fluxes, fluxes.T @ reluctance @ fluxes, eigvals_only=True).max())
