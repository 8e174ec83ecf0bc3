"""The swept sine by which a sensitivity is measured on a running loop."""

from __future__ import annotations

from amb_core.errors import RobustnessError
from amb_core.excitation import Sweep
from amb_core.parameters import Parameters, quantity


class SweepSettings(Parameters):
    """A logarithmic sweep of each axis, one after the other. It dwells where loops are slow, at low frequencies."""

    sweep_amplitude: float = quantity(0.0, "m", "peak amplitude of the swept sine; 0: nothing is measured", 0.0, 1e-3)
    sweep_duration: float = quantity(20.0, "s", "duration of the swept sine, all axes together", 1.0, 600.0)
    sweep_start: float = quantity(3.0, "Hz", "frequency at which the swept sine starts", 0.1, 1_000.0)
    sweep_end: float = quantity(2_000.0, "Hz", "frequency at which the swept sine ends", 10.0, 50e3)

    @property
    def excitation(self) -> Sweep:
        """The excitation; RobustnessError without an amplitude, or if the frequency does not rise."""
        if not self.sweep_amplitude:
            raise RobustnessError("a swept sine needs an amplitude; give sweep_amplitude (m), such as 4um")
        if self.sweep_end <= self.sweep_start:
            raise RobustnessError(
                f"sweep_end = {self.sweep_end:g} Hz is not allowed; it must exceed sweep_start, {self.sweep_start:g} Hz"
            )
        return Sweep(
            amplitude=self.sweep_amplitude,
            duration=self.sweep_duration,
            frequency_start=self.sweep_start,
            frequency_end=self.sweep_end,
            spacing="logarithmic",
            axes="in_turn",
        )
