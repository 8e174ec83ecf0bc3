"""From the response of a loop to its spectrum: blocks of whole periods, the test for a steady state, the lines.

A block has whole periods of all tones, so it is a period of every response that the tones force: in a steady state
all blocks are equal. The test checks this line by line, with phase: over `agreeing_blocks` consecutive blocks no
complex amplitude of a line on which a product falls may differ by more than `line_tolerance`, and the bias by no more
than `bias_tolerance`. The window of the spectrum is these blocks, without taper and detrending: lines are resolved
exactly, and a straight line fitted to sines would leak power to other bins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError
from amb_core.ground.units import UM
from amb_core.loop.records import LoopRecord
from amb_core.regions.subharmonics.products import Product, products_by_bin
from amb_core.regions.subharmonics.results import Line, SlowComponent, State, SubharmonicSpectrum
from amb_core.regions.subharmonics.settings import WHOLE, SubharmonicSettings


@dataclass(frozen=True)
class Blocks:
    """The whole blocks of a response.

    Attributes
    ----------
    lines : ndarray of complex, shape (blocks, lines)
        Complex amplitudes of the lines on which products fall (m).
    bias : ndarray, shape (blocks,)
        Means (m).
    """

    lines: NDArray[np.complex128]
    bias: NDArray[np.float64]

    def change(self, first: int, count: int) -> tuple[float, float]:
        """Largest difference of a line, and of the bias, between any two of `count` blocks from `first` onwards (m)."""
        lines, bias = self.lines[first : first + count], self.bias[first : first + count]
        differences = np.abs(lines[:, None] - lines[None])
        return float(differences.max(initial=0.0)), float(np.ptp(bias)) if len(bias) else 0.0


@dataclass(frozen=True)
class WindowContent:
    """The parts of a window; see the attributes of the same names of `SubharmonicSpectrum`."""

    amplitude: NDArray[np.float64]
    lines: tuple[Line, ...]
    slow: SlowComponent | None
    off_lines: float
    own: float


def analyse(
    record: LoopRecord, settings: SubharmonicSettings, first_step: int, *, delevitated: bool = False
) -> SubharmonicSpectrum:
    """Spectrum of a response to the tones of the settings.

    Parameters
    ----------
    record : LoopRecord
        Response of a loop, simulated or measured. The axis of the settings is found by its name; in a machine of
        several bearings it is that of the first one, as x_a.
    settings : SubharmonicSettings
        The tones; `longest_run` is not used; the whole record is used.
    first_step : int
        Step from which the tones have their full amplitude.
    delevitated : bool, optional
        Whether the record ends because the rotor touched the backup bearing.

    Returns
    -------
    SubharmonicSpectrum
        Over the first blocks that agree, or the last ones if none do.

    Raises
    ------
    SpectrumError
        If the record lacks the axis, a block is not a whole number of samples, a tone is at or above the Nyquist
        frequency, a sample is not finite, or the record is shorter than `agreeing_blocks` blocks although the rotor
        did not delevitate.
    """
    block, periods = block_periods(settings, record.sample_time)
    start = first_step - record.first_step
    position = _excited(record, settings, first_step)
    count = len(position) // block
    wanted = settings.agreeing_blocks
    if count < wanted and not delevitated:
        raise SpectrumError(
            f"{len(position)} samples from step {first_step} hold {count} blocks of {settings.block_duration:g} s; "
            f"the test for a steady state needs {wanted}"
        )
    products = products_by_bin(periods, block, settings.order)
    bins = np.array([place for place in products if place > 0], dtype=np.intp)
    transforms = np.fft.rfft(position[: count * block].reshape(count, block), axis=1) / block
    blocks = Blocks(2.0 * transforms[:, bins], transforms[:, 0].real)
    state, reason, first = _judge(blocks, settings, delevitated, (record.steps - start) * record.sample_time)
    used = min(wanted, count)
    line_change, bias_change = blocks.change(first, used)
    steps = used * block
    window = position[first * block : first * block + steps]
    content = _content(window, used, products, gcd(block, *periods), settings, record.sample_time)
    return SubharmonicSpectrum(
        settings=settings,
        state=state,
        reason=reason,
        sample_time=record.sample_time,
        first_step=first_step + first * block,
        steps=steps,
        frequency=np.arange(len(content.amplitude)) / (max(steps, 1) * record.sample_time),
        amplitude=content.amplitude,
        bias=float(window.mean()) if steps else float("nan"),
        lines=content.lines,
        slow=content.slow,
        off_lines=content.off_lines,
        own=content.own,
        line_change=line_change,
        bias_change=bias_change,
        block_time=(first_step + block * np.arange(count, dtype=np.float64)) * record.sample_time,
        block_bias=blocks.bias,
        block_change=np.array([blocks.change(index - 1, 2)[0] if index else np.nan for index in range(count)]),
    )


def _excited(record: LoopRecord, settings: SubharmonicSettings, first_step: int) -> NDArray[np.float64]:
    """Positions (m) of the axis of the settings, shape (steps,), from the step at which the tones are there."""
    start = first_step - record.first_step
    if start < 0:
        raise SpectrumError(f"the record begins at step {record.first_step}, after the tones, step {first_step}")
    position = record.position[start:, _column(record.axes, settings.axis)]
    if not np.isfinite(position).all():
        step = first_step + int(np.argmin(np.isfinite(position)))
        raise SpectrumError(f"position {settings.axis} at step {step} is not finite")
    return position


def _column(axes: Sequence[str], wanted: str) -> int:
    """Column of the axis of this name; in a machine of several bearings, of that of the first one, as x_a."""
    if wanted in axes:
        return axes.index(wanted)
    for column, name in enumerate(axes):
        if name.startswith(f"{wanted}_"):
            return column
    raise SpectrumError(
        f"axis = {wanted!r} is requested; axes of the record: {', '.join(axes)}; "
        f"allowed: a record with the axis {wanted}, or {wanted}_a of the first bearing"
    )


def block_periods(settings: SubharmonicSettings, sample_time: float) -> tuple[int, tuple[int, int, int]]:
    """Samples in a block, and periods of the tones in it; SpectrumError if the sample time (s) does not suit them."""
    block = round(settings.block_duration / sample_time)
    if block < 2 or abs(settings.block_duration / sample_time - block) > WHOLE:
        raise SpectrumError(
            f"block_duration = {settings.block_duration:g} s is {settings.block_duration / sample_time:g} samples at "
            f"{1.0 / sample_time:g} Hz; allowed: a whole number of samples"
        )
    f1, f2, f3 = (round(frequency * settings.block_duration) for frequency in settings.frequencies)
    periods = f1, f2, f3 if settings.inducing_amplitude > 0.0 else 0
    if 2 * max(periods) >= block:
        raise SpectrumError(
            f"a tone of {max(periods) / settings.block_duration:g} Hz is requested; allowed: below the Nyquist "
            f"frequency, {0.5 / sample_time:g} Hz"
        )
    return block, periods


def _judge(blocks: Blocks, settings: SubharmonicSettings, delevitated: bool, duration: float) -> tuple[State, str, int]:
    """State, why, and the first block of the window."""
    count, wanted = len(blocks.bias), settings.agreeing_blocks
    last = max(0, count - wanted)
    if delevitated:
        when = f"{abs(duration):.4g} s {'before' if duration < 0.0 else 'after'} the tones had their full amplitude"
        return "delevitated", f"the rotor touched the backup bearing {when}", last
    changes = [blocks.change(first, wanted) for first in range(last + 1)]
    for first, (line, bias) in enumerate(changes):
        if line <= settings.line_tolerance and bias <= settings.bias_tolerance:
            begin = first * settings.block_duration
            return "steady", f"{wanted} blocks agree from {begin:g} s at full amplitude on", first
    line, bias = changes[-1]
    moves = np.diff(blocks.bias[last:])
    one_way = bool(np.all(moves > 0.0) or np.all(moves < 0.0))
    what = (
        f"over the last {wanted} blocks of {duration:.4g} s lines differ by up to {UM * line:.3g} um "
        f"(tolerance {UM * settings.line_tolerance:.3g} um), the bias by {UM * bias:.3g} um "
        f"({UM * settings.bias_tolerance:.3g} um)"
    )
    return ("drifting" if bias > settings.bias_tolerance and one_way else "unsettled"), what, last


def _content(
    window: NDArray[np.float64],
    blocks: int,
    products: dict[int, tuple[Product, ...]],
    grid: int,
    settings: SubharmonicSettings,
    sample_time: float,
) -> WindowContent:
    """The parts of a window of whole blocks; products of any order lie on multiples of `grid` bins of a block."""
    if blocks == 0:
        return WindowContent(np.empty(0), (), None, float("nan"), float("nan"))
    transform = 2.0 * np.fft.rfft(window) / len(window)
    if len(window) % 2 == 0:
        transform[-1] *= 0.5  # the Nyquist frequency has no mirror image
    transform[0] = 0.0
    amplitude = np.abs(transform)
    resolution = 1.0 / (len(window) * sample_time)
    lines = tuple(
        Line(place * blocks * resolution, complex(transform[place * blocks]), candidates)
        for place, candidates in products.items()
        if place > 0
    )
    power = 0.5 * amplitude**2
    highest = max(1, min(int(settings.slow_limit / resolution + WHOLE), len(power) - 1))
    largest = 1 + int(np.argmax(amplitude[1 : highest + 1]))
    forced = largest % (grid * blocks) == 0
    slow = SlowComponent(
        largest * resolution,
        float(amplitude[largest]),
        float(np.sqrt(power[1 : highest + 1].sum())),
        forced,
        products.get(largest // blocks, (None,))[0] if forced else None,
    )
    power[[place * blocks for place in products]] = 0.0
    off_lines = float(np.sqrt(power.sum()))
    power[:: grid * blocks] = 0.0
    return WindowContent(amplitude, lines, slow, off_lines, float(np.sqrt(power.sum())))
