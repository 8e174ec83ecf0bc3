"""Limits and excitations of a commissioning; each is an option of `amb commission`."""

from __future__ import annotations

from amb_core.ground.parameters import Parameters, quantity


class CommissioningSettings(Parameters):
    """What is measured, and the limits that it is compared with."""

    observation: float = quantity(3.0, "s", "time for which link and sensors are observed before levitation", 0.5, 60.0)
    lost_share: float = quantity(1e-3, "-", "share of telemetry that may be lost in that time", 0.0, 1.0)
    most_missed: int = quantity(0, "-", "control steps that the target may miss in that time", 0, 1_000_000_000)
    round_trip: float = quantity(0.01, "s", "longest time from a command to its reply", 1e-4, 10.0)
    clock_drift: float = quantity(500.0, "ppm", "largest drift of the target's clock against the host's", 0.1, 1e7)
    noise: float = quantity(2e-6, "m", "largest noise of a sensor while the rotor rests, rms", 1e-9, 1e-3)
    rest_share: float = quantity(
        1.2,
        "-",
        "radial position of the resting rotor over clearance; more than 1, since bearings have play",
        0.1,
        10.0,
    )
    orbit_share: float = quantity(0.05, "-", "largest orbit of the levitated rotor at rest over clearance", 1e-4, 1.0)
    current_share: float = quantity(0.8, "-", "largest control current at rest over its limit", 0.01, 1.0)
    repeatability: float = quantity(
        5e-6, "m", "largest change of the position from one levitation to the next", 0.0, 1e-3
    )
    step_amplitude: float = quantity(5e-6, "m", "amplitude of the small steps of the reference", 1e-7, 1e-4)
    gain_low: float = quantity(0.5, "-", "least position over reference at rest, without a model", 0.0, 10.0)
    gain_high: float = quantity(3.0, "-", "largest position over reference at rest, without a model", 0.1, 100.0)
    gain_error: float = quantity(0.2, "-", "largest relative error of that gain against the model", 0.001, 10.0)
    coupling: float = quantity(0.2, "-", "largest motion of another axis over that of the excited one", 0.001, 10.0)
    current_error: float = quantity(
        0.3, "A", "largest error of the static control current against the model", 1e-3, 100.0
    )
    sweep_amplitude: float = quantity(4e-6, "m", "amplitude of the sweep", 1e-7, 1e-4)
    sweep_duration: float = quantity(10.0, "s", "duration of the sweep of all axes together", 1.0, 600.0)
    sweep_start: float = quantity(5.0, "Hz", "frequency at which the sweep starts", 0.1, 1_000.0)
    sweep_end: float = quantity(200.0, "Hz", "frequency at which the sweep ends", 10.0, 5_000.0)
    resonance_error: float = quantity(
        0.1, "-", "largest relative error of the natural frequency against the model", 1e-3, 10.0
    )
    damping_error: float = quantity(0.1, "-", "largest error of the damping ratio against the model", 1e-3, 10.0)
    multisine_amplitude: float = quantity(5e-6, "m", "amplitude of the multisine", 1e-7, 1e-4)
    multisine_duration: float = quantity(8.0, "s", "duration of the multisine", 1.0, 600.0)
    multisine_end: float = quantity(600.0, "Hz", "highest frequency of the multisine", 100.0, 20_000.0)
    unexplained: float = quantity(
        20.0, "percent", "largest part of the motion that the identified model leaves unexplained, rms", 0.1, 100.0
    )
    fade: float = quantity(0.5, "s", "longest time until an excitation that is stopped has faded", 1e-3, 100.0)
