"""Figures of a plant: its iron, its static force, and how fast the force follows the current.

Made without pyplot, as those of `amb_core.report.figures`; save one with `figure.savefig`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.ground.extras import extra
from amb_core.plant.eddy import eddy_bandwidth, force_response
from amb_core.plant.iron import initial_iron, pack_material, saturation_curve
from amb_core.plant.kernel.iron import advance_hysteresis
from amb_core.plant.kernel.records import ELEMENTS
from amb_core.plant.network import COIL_AXES
from amb_core.plant.operating_point import static_force
from amb_core.plant.parameters import IronParameters, PlantParameters
from amb_core.plant.plant import Plant

with extra("figures"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73")
_LOOPS = (0.4, 0.8, 1.2)  # peak flux densities (T)
_STEPS = 2000  # per quarter of a loop


def iron_figure(parameters: PlantParameters) -> Figure:
    """Flux density over field of the iron: the line, curve or loops of the parameters."""
    iron = parameters.iron
    figure, axes = _axes("Magnetisation of the iron", "field H (A/m)", "flux density B (T)")
    if iron.saturation:
        curve = saturation_curve(iron)
        density = np.linspace(-curve.end, curve.end, 801)
        label = "anhysteretic curve" if iron.hysteresis else "curve"
        axes.plot(curve.field(density), density, color="#999999", linewidth=1.0, label=label)
        reach = 2.0 * float(curve.field(np.array([max(_LOOPS)]))[0])
    else:
        density = np.linspace(-1.5, 1.5, 2)
        reach = 1.5 / (mu_0 * parameters.magnetic_circuit.relative_permeability)
        label = f"relative permeability {parameters.magnetic_circuit.relative_permeability:g}"
        axes.plot(density / 1.5 * reach, density, color=COLOURS[0], label=label)
    if iron.hysteresis:
        for peak, colour in zip(_LOOPS, COLOURS, strict=True):
            field, density = hysteresis_loop(iron, peak)
            axes.plot(field, density, color=colour, linewidth=1.3, label=f"loop of {peak:g} T")
        field, density = hysteresis_loop(iron, 0.15, bias=0.9)
        axes.plot(field, density, color="black", linewidth=1.0, label="minor loop, 0.9 T +/- 0.15 T")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-1.6, 1.6)
    axes.legend(loc="lower right", fontsize="small")
    return figure


def hysteresis_loop(
    iron: IronParameters, peak: float, bias: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Field (A/m) and flux density (T) over the third cycle of a triangular flux density.

    Parameters
    ----------
    iron : IronParameters
        The material.
    peak, bias : float
        Amplitude and mean of the flux density (T).
    """
    quarter = np.linspace(0.0, 1.0, _STEPS, endpoint=False)
    cycle = bias + peak * np.concatenate([quarter, 1.0 - quarter, -quarter, quarter - 1.0])
    rise = np.linspace(0.0, bias, _STEPS, endpoint=False)
    density = np.concatenate([rise, np.tile(cycle, 3), [bias]])
    state, material = initial_iron(np.zeros(ELEMENTS), iron), pack_material(iron)
    field = np.empty(len(density))
    for n, value in enumerate(density):
        state["target"] = value
        advance_hysteresis(state, material)
        field[n] = state["field"][0]
        assert state["flux_density"][0] == value
    last = slice(-len(cycle) - 1, None)
    return field[last], density[last]


def force_figure(parameters: PlantParameters) -> Figure:
    """Static force along the first axis over the control current, with the journal centred and to either side."""
    plant = Plant(parameters)
    axis = "xy".index(plant.axes[0])
    limit = (
        parameters.amplifier.current_limit if parameters.amplifier.limits else 3.0 * parameters.amplifier.bias_current
    )
    bias = plant.bias_currents()
    control = np.linspace(-limit, limit, 81)
    name = plant.axes[0]
    figure, axes = _axes("Static force", f"control current i_{name} (A)", f"force along {name} (N)")
    offset = 0.4 * parameters.rotor.backup_bearing_radius
    for displacement, colour in zip((0.0, offset, -offset), COLOURS, strict=True):
        position = np.zeros(2)
        position[axis] = displacement
        force = [
            static_force(plant, np.clip(bias + (bias > 0.0) * COIL_AXES[:, axis] * i, 0.0, limit), position)[axis]
            for i in control
        ]
        axes.plot(control, force, color=colour, label=f"{name} = {1e6 * displacement:+.0f} um")
    axes.legend(fontsize="small")
    return figure


def bandwidth_figure(parameters: PlantParameters) -> Figure:
    """Force per control current over frequency, relative to that at rest, in closed form; with -3 dB marked.

    Raises
    ------
    PlantError
        For a bearing with 1 DOF and shared flux, for which there is no closed form.
    """
    bandwidth = eddy_bandwidth(parameters)
    highest = 10.0 * bandwidth if np.isfinite(bandwidth) else 1e5
    frequency = np.geomspace(1.0, highest, 400)
    at_rest = abs(force_response(parameters, np.array([1e-6]))[0])
    gain = 20.0 * np.log10(np.abs(force_response(parameters, frequency)) / at_rest)
    figure, axes = _axes("Force per current under eddy currents", "frequency (Hz)", "gain (dB)")
    axes.semilogx(frequency, gain, color=COLOURS[0])
    axes.axhline(-20.0 * np.log10(np.sqrt(2.0)), color="#999999", linewidth=0.8)
    if np.isfinite(bandwidth):
        axes.axvline(bandwidth, color=COLOURS[1], linestyle="--", label=f"-3 dB at {bandwidth:.3g} Hz")
        axes.legend(loc="lower left", fontsize="small")
    return figure


def _axes(title: str, horizontal: str, vertical: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.4, 4.4), layout="constrained", dpi=150)
    axes = figure.add_subplot(title=title, xlabel=horizontal, ylabel=vertical)
    axes.grid(linewidth=0.4, color="#DDDDDD")
    return figure, axes
