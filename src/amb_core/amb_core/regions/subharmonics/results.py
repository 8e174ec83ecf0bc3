"""Results of the subharmonic test: the spectrum of one response, and the surface over many inducing tones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.subharmonics.products import Product
from amb_core.regions.subharmonics.settings import SubharmonicSettings, SurfaceSettings

# steady: consecutive blocks agree. drifting: the bias still moves one way. unsettled: lines or bias keep changing.
# delevitated: the rotor reached the backup bearing.
State = Literal["steady", "drifting", "unsettled", "delevitated"]


@dataclass(frozen=True)
class Line:
    """A line of the spectrum on which at least one product falls.

    Attributes
    ----------
    frequency : float
        Between 0 and the Nyquist frequency (Hz).
    amplitude : complex
        Complex amplitude of the position at the first step of the window (m): the line is Re(amplitude e^(j w t)).
    products : tuple of Product
        All products up to the order of the settings that fall here, lowest order first; never empty.
    """

    frequency: float
    amplitude: complex
    products: tuple[Product, ...]

    @property
    def product(self) -> Product:
        """The product of the lowest order, which counts as the cause of the line."""
        return self.products[0]


@dataclass(frozen=True)
class SlowComponent:
    """Motion slower than `slow_limit`.

    Attributes
    ----------
    frequency : float
        Frequency of the largest line above 0 Hz and up to `slow_limit` (Hz).
    amplitude : float
        Its peak amplitude (m).
    rms : float
        Root mean square of everything in the band (m).
    forced : bool
        Whether its frequency is a multiple of the greatest common divisor of the tones and the sample rate, as for
        every product of any order. Otherwise it is motion of the loop's own, or drift.
    product : Product or None
        The product of lowest order that falls on it; None if there is none up to the order of the settings.
    """

    frequency: float
    amplitude: float
    rms: float
    forced: bool
    product: Product | None

    @property
    def origin(self) -> str:
        """Its cause: a product such as `10f3 - 3fs`, `higher order`, or `own` for motion that is not forced."""
        if not self.forced:
            return "own"
        return "higher order" if self.product is None else self.product.label


@dataclass(frozen=True)
class SubharmonicSpectrum:
    """Response to the tones: its spectrum over the last blocks, and whether they are of a steady state.

    Attributes
    ----------
    settings : SubharmonicSettings
        The tones, and the criteria for the response.
    state : str
        `steady`, `drifting`, `unsettled` or `delevitated`; only `steady` makes the amplitudes those of a steady state.
    reason : str
        The reason, in one line.
    sample_time : float
        Sample time (s).
    first_step, steps : int
        Window of the spectrum: `agreeing_blocks` blocks, fewer if the run is shorter; 0 steps if no block is whole.
    frequency : ndarray, shape (steps // 2 + 1,)
        Bins from 0 Hz to the Nyquist frequency (Hz); empty without a window.
    amplitude : ndarray, shape (steps // 2 + 1,)
        Peak amplitude of the position in each bin (m); 0 at 0 Hz: the mean is `bias`.
    bias : float
        Mean position over the window (m).
    lines : tuple of Line
        Lines on which products fall, lowest frequency first, 0 Hz left out.
    slow : SlowComponent or None
        None without a window.
    off_lines : float
        Root mean square of everything off the lines (m): products of higher order, noise, and motion of the loop's own.
    own : float
        Root mean square of everything at frequencies where no product of any order can be (m), see
        `SlowComponent.forced`: noise, drift, and motion of the loop's own.
    line_change, bias_change : float
        Largest difference between two blocks of the window, of a line's complex amplitude and of the bias (m).
    block_time : ndarray, shape (blocks,)
        Start of every whole block after the fade-in (s).
    block_bias : ndarray, shape (blocks,)
        Mean position in each (m).
    block_change : ndarray, shape (blocks,)
        Largest difference of a line between a block and the one before (m); NaN for the first.
    """

    settings: SubharmonicSettings
    state: State
    reason: str
    sample_time: float
    first_step: int
    steps: int
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    bias: float
    lines: tuple[Line, ...]
    slow: SlowComponent | None
    off_lines: float
    own: float
    line_change: float
    bias_change: float
    block_time: NDArray[np.float64]
    block_bias: NDArray[np.float64]
    block_change: NDArray[np.float64]

    def line(self, a: int, b: int, c: int = 0) -> Line | None:
        """The line on which the product a f1 + b f2 + c f3 falls; None if it falls on 0 Hz or was not searched for.

        Parameters
        ----------
        a, b, c : int, optional
            Whole multiples of the three tones.

        Returns
        -------
        Line or None
            The line with its amplitude.
        """
        wanted = {(a, b, c), (-a, -b, -c)}
        for line in self.lines:
            if any((product.a, product.b, product.c) in wanted for product in line.products):
                return line
        return None


@dataclass(frozen=True)
class SubharmonicSurface:
    """Size of the lowest components over amplitude and frequency of the inducing tone (paper, Fig. 7).

    Attributes
    ----------
    settings : SubharmonicSettings
        The test; its inducing tone is replaced by those of the surface.
    surface : SurfaceSettings
        Which inducing tones.
    inducing_amplitude : ndarray, shape (n,)
        Amplitudes of the inducing tone (m).
    inducing_frequency : ndarray, shape (m,)
        Frequencies of the inducing tone (Hz).
    difference : ndarray, shape (n, m)
        Peak amplitude of the line at f2 - f1 (m); NaN where there is no steady state.
    slow_amplitude, slow_frequency, slow_rms : ndarray, shape (n, m)
        Of the slow component, see `SlowComponent` (m, Hz, m); NaN only where the rotor delevitated, so read `state`.
    slow_origin : ndarray of str, shape (n, m)
        Cause of the slow component, see `SlowComponent.origin`; empty where the rotor delevitated.
    bias : ndarray, shape (n, m)
        Mean position (m); NaN where the rotor delevitated.
    state : ndarray of str, shape (n, m)
        State of each response.
    """

    settings: SubharmonicSettings
    surface: SurfaceSettings
    inducing_amplitude: NDArray[np.float64]
    inducing_frequency: NDArray[np.float64]
    difference: NDArray[np.float64]
    slow_amplitude: NDArray[np.float64]
    slow_frequency: NDArray[np.float64]
    slow_rms: NDArray[np.float64]
    slow_origin: NDArray[np.str_]
    bias: NDArray[np.float64]
    state: NDArray[np.str_]
