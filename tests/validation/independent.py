"""The kernel against an implicit solution of the same equations, restarted at every switching instant."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import AmplifierParameters, IntegrationParameters, Plant, PlantParameters, RotorParameters
from amb_core.plant.parameters import (
    ConverterParameters,
    IronParameters,
    RigidRotorParameters,
    SensorParameters,
)
from tests.validation.implicit_plant import ImplicitPlant
from tests.validation.row import Row

IRON = IronParameters(saturation=True, hysteresis=True, solid_journal=True)
# Through a solid journal a voltage drives so much current at once that the usual gain would oscillate from period to
# period.
AMPLIFIER = AmplifierParameters(carriers="interleaved", dead_time=0.3e-6, proportional_gain=0.4)
# Internal steps of 0.5 us lose reversals of the flux density that are shorter, and the fastest diffusion into a solid
# journal lasts but two of them: 1.1 nm and 1.2 mA.
FINE = IntegrationParameters(internal_step=0.125e-6)
DISTURBED = {
    "running_speed": 120.0,
    "unbalance": 2e-5,
    "external_force_x": 10.0,
    "external_force_y": -5.0,
    "external_force_frequency": 150.0,
}
RIGID = RotorParameters(model="rigid", **DISTURBED)
BODY = RigidRotorParameters(bearing_a=-0.14, bearing_b=0.16, sensor_a=-0.16, sensor_b=0.19)
SENSOR = SensorParameters(bandwidth=8e3)
DELAY = ConverterParameters(computation_delay=0.4)
# A converter hides deviations below its step from the loop, where they grow as without control (a hundredfold in 20 ms)
# until a position falls on the other side of a step: over a short time only.
CONVERTERS = ConverterParameters(position_resolution=50e-9, current_resolution=1e-3, computation_delay=0.4)

# Parameters and number of samples; the longest first, as two run at a time
CASES = {
    "hysteresis, solid journal, interleaved carriers, dead time": (
        PlantParameters(iron=IRON, amplifier=AMPLIFIER, integration=FINE),
        200,
    ),
    "rigid rotor": (
        PlantParameters(rotor=RIGID, rigid_rotor=BODY, sensor=SENSOR, converters=DELAY),
        200,
    ),
    "paper": (PlantParameters(), 200),
    "diffusion into laminations": (PlantParameters(iron=IronParameters(laminations="diffusion")), 50),
    "saturation": (PlantParameters(iron=IronParameters(saturation=True)), 200),
    "everything": (
        PlantParameters(
            iron=IRON,
            amplifier=AMPLIFIER,
            rotor=RIGID,
            rigid_rotor=BODY,
            sensor=SENSOR,
            converters=CONVERTERS,
            integration=FINE,
        ),
        20,
    ),
}


def rows(longest: int = 200) -> Iterator[Row]:
    """Largest deviations in closed loop: a step of 5 um on x at a tenth of the run, a sine of 5 um, 200 Hz on y."""
    cases = {name: (parameters, min(samples, longest)) for name, (parameters, samples) in CASES.items()}
    with ProcessPoolExecutor(max_workers=2) as pool:
        deviations = pool.map(compare, *zip(*cases.values(), strict=True))
        for (name, (parameters, samples)), (position, current) in zip(cases.items(), deviations, strict=True):
            integration = parameters.integration
            steps = f"{1e3 * samples / integration.sample_rate:g} ms in steps of {1e6 * integration.internal_step:g} us"
            yield Row(f"solve_ivp (Radau, rtol 1e-9), {name}, {steps}: positions", 1e9 * position, 1.0, "nm")
            yield Row(f"solve_ivp (Radau, rtol 1e-9), {name}, {steps}: currents", 1e3 * current, 1.0, "mA")


def compare(parameters: PlantParameters, samples: int) -> tuple[float, float]:
    """Largest deviation of positions (m) and coil currents (A) at the starts of all switching periods."""
    plant = Plant(parameters)
    implicit = ImplicitPlant(plant)
    period = parameters.steps_per_period
    position_deviation, current_deviation = 0.0, 0.0
    axes = len(plant.machine.axes)
    ours, theirs = (PdController(ControllerParameters(), axes) for _ in range(2))
    for sample in range(samples):
        reference = np.zeros(axes)
        reference[:2] = _reference(sample, samples)
        trace = plant.trace(ours.update(plant.position, reference))
        traces = [trace, trace.bearing_b] if trace.bearing_b is not None else [trace]
        if min(part.current.min() for part in traces) <= 0.0:
            raise RuntimeError("a coil current reached zero: the solution to compare with has no diodes")
        positions, currents = implicit.advance(theirs.update(implicit.measured(), reference))
        position = np.hstack([part.position[::period] for part in traces])
        current = np.hstack([part.current[::period] for part in traces])
        position_deviation = max(position_deviation, _largest(position - positions))
        current_deviation = max(current_deviation, _largest(current - currents))
    return position_deviation, current_deviation


def _reference(sample: int, samples: int) -> tuple[float, float]:
    return (5e-6 if sample >= samples // 10 else 0.0), 5e-6 * np.sin(2.0 * np.pi * 200.0 * sample * 1e-4)


def _largest(values: NDArray[np.float64]) -> float:
    return float(np.abs(values).max())
