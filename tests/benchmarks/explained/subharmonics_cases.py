"""Loops and tests of the page on the subharmonic test, and what its tables take from a response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from amb_core.ground.parameters import load_parameters
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.simulation.parameters import with_values
from amb_core.regions.subharmonics import SubharmonicSettings, SubharmonicSpectrum, run_subharmonics
from tests.front_door.results import ROOT

RIG = ROOT / "src" / "amb_bringup" / "config" / "rig.yaml"
Value = tuple[str, Any]
Tables = dict[str, dict[str, list["Case"]]]

LIMIT_10: Value = ("controller.current_limit", 10.0)
DIFFERENTIAL: Value = ("magnetic_circuit.actuators", "differential")
REFERENCE_0: Value = ("controller.nominal_reference", (0.0, 0.0, 0.0, 0.0))  # the weight pulls the rotor down


@dataclass(frozen=True)
class Loop:
    """The paper's bearing or the rig, with some values changed."""

    values: tuple[Value, ...] = ()
    rig: bool = False

    def parameters(self) -> tuple[PlantParameters, ControllerParameters]:
        """Of plant and controller."""
        plant, controller = PlantParameters(), ControllerParameters()
        if self.rig:
            plant = load_parameters(PlantParameters, RIG, "simulator", part=True)
            controller = load_parameters(ControllerParameters, RIG, "pd_controller", part=True)
        return with_values(plant, controller, dict(self.values))


LOOPS = {
    "given": Loop(),
    "limit_10": Loop((LIMIT_10,)),
    "differential": Loop((DIFFERENTIAL,)),
    "differential_limit_10": Loop((DIFFERENTIAL, LIMIT_10)),
    "top_coil": Loop((("magnetic_circuit.actuators", "top_coil"),)),
    "no_gravity": Loop((("rotor.gravity", 0.0),)),
    "on_measurement": Loop((("controller.derivative_on", "measurement"),)),
    "rig": Loop(rig=True),
    "rig_limit_10": Loop((LIMIT_10,), rig=True),
    "rig_low": Loop((REFERENCE_0,), rig=True),
    "rig_low_limit_10": Loop((REFERENCE_0, LIMIT_10), rig=True),
}


@dataclass(frozen=True)
class Case:
    """A loop and its test."""

    loop: Loop
    test: SubharmonicSettings


@dataclass(frozen=True)
class Response:
    """Amplitudes (um) and frequencies (Hz) of a spectrum; None, but for the bias, without a steady state.

    Attributes
    ----------
    delevitated : bool
        Whether the rotor fell.
    bias : float or None
        None if it fell.
    first, second, difference, third_order, tenth : float or None
        Lines f1, f2, f2 - f1, 2 f1 - f2 and 10 f3 - 3 f_s.
    tenth_hz : float or None
        Frequency of the last.
    slow, slow_hz : float or None
        Largest line of the band of slow components.
    band, folded, unfolded, rest : float or None
        Root mean squares of the band of slow components, of its lines by whether their product of lowest order is
        folded, and of what is on none of them.
    """

    delevitated: bool
    bias: float | None
    first: float | None = None
    second: float | None = None
    difference: float | None = None
    third_order: float | None = None
    tenth: float | None = None
    tenth_hz: float | None = None
    slow: float | None = None
    slow_hz: float | None = None
    band: float | None = None
    folded: float | None = None
    unfolded: float | None = None
    rest: float | None = None


def respond(case: Case) -> Response:
    """Run a test."""
    spectrum = run_subharmonics(*case.loop.parameters(), case.test)
    fell = spectrum.state == "delevitated"
    bias = None if fell else um(spectrum.bias)
    if spectrum.state != "steady" or spectrum.slow is None:
        return Response(fell, bias)
    tenth = spectrum.line(0, 0, 10)
    return Response(
        fell,
        bias,
        first=_line(spectrum, 1, 0),
        second=_line(spectrum, 0, 1),
        difference=_line(spectrum, -1, 1),
        third_order=_line(spectrum, 2, -1),
        tenth=_line(spectrum, 0, 0, 10),
        tenth_hz=None if tenth is None else round(tenth.frequency, 4),
        slow=um(spectrum.slow.amplitude),
        slow_hz=round(spectrum.slow.frequency, 4),
        **_band(spectrum, spectrum.slow.rms),
    )


def um(metres: float) -> float:
    """Micrometres, to a hundredth of a nanometre."""
    return round(UM * float(metres), 5)


def _line(spectrum: SubharmonicSpectrum, a: int, b: int, c: int = 0) -> float | None:
    line = spectrum.line(a, b, c)
    return None if line is None else um(abs(line.amplitude))


def _band(spectrum: SubharmonicSpectrum, band: float) -> dict[str, float]:
    """The band of slow components, and its parts."""
    slow = [line for line in spectrum.lines if line.frequency <= spectrum.settings.slow_limit]
    power = {
        folded: sum(0.5 * abs(line.amplitude) ** 2 for line in slow if (line.product.folds != 0) == folded)
        for folded in (True, False)
    }
    return {
        "band": um(band),
        "folded": um(np.sqrt(power[True])),
        "unfolded": um(np.sqrt(power[False])),
        "rest": um(np.sqrt(max(0.0, band**2 - power[True] - power[False]))),
    }
