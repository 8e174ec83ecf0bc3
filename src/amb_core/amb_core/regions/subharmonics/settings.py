"""Settings of the subharmonic test: tones, blocks, and the criteria for a steady response."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from amb_core.excitation.deterministic import HIGHEST_AMPLITUDE, HIGHEST_FREQUENCY
from amb_core.ground.parameters import Parameters, choice, quantity, switch, validate

# Periods per block count as whole within this: rounding of the product of a frequency and a duration.
WHOLE = 1e-6


class SubharmonicSettings(Parameters):
    """Two tones, a third one to induce nonlinear behaviour (paper, Fig. 6), and the criteria for the response.

    Every tone has a whole number of periods in a block. Every product a f1 + b f2 + c f3 then has a whole number too,
    folded at the sample rate or not: all fall on bins of the block's Fourier transform and none leaks into another.
    """

    frequency_1: float = quantity(200.0, "Hz", "frequency of the first tone, f1", 1e-3, HIGHEST_FREQUENCY)
    amplitude_1: float = quantity(10e-6, "m", "peak amplitude of the first tone", 1e-9, HIGHEST_AMPLITUDE)
    frequency_2: float = quantity(300.0, "Hz", "frequency of the second tone, f2", 1e-3, HIGHEST_FREQUENCY)
    amplitude_2: float = quantity(10e-6, "m", "peak amplitude of the second tone", 1e-9, HIGHEST_AMPLITUDE)
    inducing_frequency: float = quantity(3000.0, "Hz", "frequency of the inducing tone, f3", 1e-3, HIGHEST_FREQUENCY)
    inducing_amplitude: float = quantity(
        40e-6, "m", "peak amplitude of the inducing tone; 0 for none", 0.0, HIGHEST_AMPLITUDE
    )
    inducing_phase: float = quantity(0.0, "rad", "phase of the inducing tone at its first sample", -10.0, 10.0)
    axis: Literal["x", "y"] = choice("y", "axis whose reference carries the tones and whose position is analysed")
    offset_1: float = quantity(1.0, "Hz", "shift of f1 in the shifted test", -1000.0, 1000.0)
    offset_2: float = quantity(-1.0, "Hz", "shift of f2 in the shifted test", -1000.0, 1000.0)
    offset_3: float = quantity(7.0, "Hz", "shift of f3 in the shifted test", -1000.0, 1000.0)
    order: int = quantity(12, "-", "highest order abs(a) + abs(b) + abs(c) of the products searched for", 2, 20)
    slow_limit: float = quantity(80.0, "Hz", "upper end of the band of slow components", 1.0, 1000.0)
    rest: float = quantity(0.5, "s", "time at rest before the tones, in which the rotor settles", 0.0, 60.0)
    fade_in: float = quantity(0.5, "s", "time in which the tones rise along half a cosine; 0 for at once", 0.0, 60.0)
    block_duration: float = quantity(1.0, "s", "length of a block: whole periods of every tone", 1e-3, 100.0)
    agreeing_blocks: int = quantity(3, "-", "consecutive blocks that must agree", 2, 100)
    longest_run: float = quantity(
        12.0, "s", "deadline after the fade-in by which the response must be steady", 0.0, 1e4
    )
    line_tolerance: float = quantity(
        0.05e-6, "m", "largest difference of a line's complex amplitude between agreeing blocks", 0.0, 1e-3
    )
    bias_tolerance: float = quantity(0.1e-6, "m", "largest difference of the bias between agreeing blocks", 0.0, 1e-3)

    @model_validator(mode="after")
    def _tones_fit_the_block(self) -> Self:
        tones = {
            name: getattr(self, name)
            for name in ("frequency_1", "frequency_2", "inducing_frequency")
            if name != "inducing_frequency" or self.inducing_amplitude > 0.0
        }
        if len(set(tones.values())) < len(tones):
            raise ValueError(
                "two tones have the same frequency: "
                + ", ".join(f"{name} = {value:g} Hz" for name, value in tones.items())
                + "; allowed: different ones, because products can only separate different tones"
            )
        for name, frequency in tones.items():
            periods = frequency * self.block_duration
            if round(periods) < 1 or abs(periods - round(periods)) > WHOLE:
                below = max(1, int(periods))
                raise ValueError(
                    f"{name} = {frequency:g} Hz has {periods:g} periods in block_duration = {self.block_duration:g} s; "
                    f"allowed: whole periods, as {below / self.block_duration:g} Hz and "
                    f"{(below + 1) / self.block_duration:g} Hz have"
                )
        least = self.agreeing_blocks * self.block_duration
        if self.longest_run < least:
            raise ValueError(
                f"longest_run = {self.longest_run:g} s must hold agreeing_blocks = {self.agreeing_blocks} blocks, "
                f"{least:g} s"
            )
        return self

    @property
    def frequencies(self) -> tuple[float, float, float]:
        """Frequencies f1, f2, f3 (Hz)."""
        return self.frequency_1, self.frequency_2, self.inducing_frequency

    @property
    def amplitudes(self) -> tuple[float, float, float]:
        """Peak amplitudes of the three tones (m)."""
        return self.amplitude_1, self.amplitude_2, self.inducing_amplitude

    def shifted(self) -> Self:
        """The same test with tones moved by the offsets, which separates products that coincide.

        Returns
        -------
        SubharmonicSettings
            The changed settings.
        """
        return self.changed(
            frequency_1=self.frequency_1 + self.offset_1,
            frequency_2=self.frequency_2 + self.offset_2,
            inducing_frequency=self.inducing_frequency + self.offset_3,
        )

    def changed(self, **values: float) -> Self:
        """The same test with other values.

        Parameters
        ----------
        **values : float
            Parameters by name (units of their declarations).

        Returns
        -------
        SubharmonicSettings
            The changed settings.

        Raises
        ------
        ParameterError
            If they do not fit together.
        """
        return validate(type(self), {**self.model_dump(), **values})


class SurfaceSettings(Parameters):
    """Inducing tones as in the paper's Fig. 7, which gives no ranges: all pairs of amplitudes and frequencies.

    Both are at equal distances. Frequencies are rounded to whole periods in a block.
    """

    amplitude_low: float = quantity(5e-6, "m", "smallest amplitude of the inducing tone", 0.0, HIGHEST_AMPLITUDE)
    amplitude_high: float = quantity(50e-6, "m", "largest amplitude of the inducing tone", 0.0, HIGHEST_AMPLITUDE)
    amplitude_count: int = quantity(10, "-", "number of amplitudes", 1, 1000)
    frequency_low: float = quantity(500.0, "Hz", "lowest frequency of the inducing tone", 1e-3, HIGHEST_FREQUENCY)
    frequency_high: float = quantity(4500.0, "Hz", "highest frequency of the inducing tone", 1e-3, HIGHEST_FREQUENCY)
    frequency_count: int = quantity(17, "-", "number of frequencies", 1, 1000)
    shifted: bool = switch(False, "all tones are moved by the offsets of the test, so that products come apart")

    @model_validator(mode="after")
    def _ranges_ascend(self) -> Self:
        for name, unit in (("amplitude", "m"), ("frequency", "Hz")):
            low, high, count = (getattr(self, f"{name}_{part}") for part in ("low", "high", "count"))
            if low > high or (low == high) != (count == 1):
                raise ValueError(
                    f"{name}_low = {low:g} {unit}, {name}_high = {high:g} {unit} and {name}_count = {count} do not fit "
                    f"together; allowed: low below high with a count of 2 or more, or equal with a count of 1"
                )
        return self
