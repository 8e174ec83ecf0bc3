"""Fig. 6 and 7: products of three tones in the response, and a slow component caused by the third tone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.subharmonics import (
    SubharmonicSettings,
    SubharmonicSpectrum,
    SubharmonicSurface,
    SurfaceSettings,
    run_subharmonics,
    subharmonic_surface,
)
from amb_core.report.figures.spectrum import spectrum_chart
from amb_core.report.figures.surface import surface_chart
from amb_core.report.pages import Answer
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, Workplace

POINT_MASS = {"rotor": Setting("a point mass instead of the rigid rotor in two bearings", "against section 2.3")}
CURRENT_LIMIT = 10.0  # A; with the default of 3 A the third tone throws the rotor out
SURFACE = SurfaceSettings(amplitude_low=5e-6, amplitude_high=40e-6, amplitude_count=8, shifted=True)
LONGEST_RUN = 6.0  # s, deadline of a run of the surface
SIGNIFICANT = 0.1  # ratio of the product to the smaller tone's response above which it is significant
STRONG = 10.0  # ratio of the largest to the smallest slow component that makes an influence strong
PAPER_SLOW = 2.2  # Hz, frequency of the slow component in the paper's Fig. 7
FOLDED = "10 f3 - 3 fs"  # product that sampling folds to ten times the offset of the third tone from 3 kHz


class Subharmonics(Study):
    """Tones of 200 and 300 Hz, and a third one to induce nonlinear behaviour."""

    name = "fig6-7"
    heading = "Fig. 6 and 7: products of three tones"
    against: ClassVar[Mapping[str, Setting]] = {**POINT_MASS, **LINEAR_IRON}
    parallel = False  # the surface is made on the cluster

    def run(self) -> StudyResult:
        """As `run_at`, on this machine."""
        return self.run_at(Workplace())

    def run_at(self, workplace: Workplace) -> StudyResult:
        """The paper's test, the same without its third tone and with shifted ones, and the surface."""
        plant, controller = PlantParameters(), ControllerParameters(current_limit=CURRENT_LIMIT)
        settings = SubharmonicSettings()
        three = run_subharmonics(plant, controller, settings)
        two = run_subharmonics(plant, controller, settings.changed(inducing_amplitude=0.0))
        shifted = run_subharmonics(plant, controller, settings.changed(inducing_amplitude=5e-6).shifted())
        limited = run_subharmonics(plant, ControllerParameters(), settings)
        surface = subharmonic_surface(
            plant,
            controller,
            settings.changed(longest_run=LONGEST_RUN),
            SURFACE,
            cache=workplace.cache,
            scheduler=workplace.scheduler,
            workers=workplace.workers,
            progress=lambda _stage, done, total: workplace.report(f"tone {done} of {total}"),
        )
        spectra = {
            f"third tone of {UM * settings.inducing_amplitude:g} µm at {settings.inducing_frequency:g} Hz": three,
            "two tones alone": two,
            f"all tones shifted, third of {UM * shifted.settings.inducing_amplitude:g} µm at "
            f"{shifted.settings.inducing_frequency:g} Hz": shifted,
        }
        return self.result(
            [
                DrawnFigure.of("fig6", spectrum_chart(spectra, "Response on y to tones of 200 and 300 Hz and a third")),
                DrawnFigure.of("fig7", surface_chart(surface, "Effect of inducing tones, all tones shifted")),
            ],
            [judge_product(three), judge_cause(two, three), judge_slow(three, shifted), judge_influence(surface)],
            _settings(settings),
            [
                "The paper's tones and the sample rate are all multiples of 100 Hz, so many products coincide, "
                "including those folded by sampling. A shift of the tones by a few Hz separates them. "
                f"With the default limit of the control current, {ControllerParameters().current_limit:g} A, the "
                f"bearing is {limited.state} under the paper's third tone"
                + (f": {limited.reason}." if limited.state != "steady" else ".")
            ],
        )


def _settings(settings: SubharmonicSettings) -> dict[str, Setting]:
    amplitudes = f"{UM * SURFACE.amplitude_low:g} to {UM * SURFACE.amplitude_high:g} µm"
    return {
        "tones": Setting("10 µm at 200 Hz, 10 µm at 300 Hz, 40 µm at 3 kHz, in steady state", "stated: section 2.3"),
        "axis": Setting("y", "assumed; the paper shows the spectrum of y"),
        "control current limit": Setting(f"{CURRENT_LIMIT:g} A"),
        "surface": Setting(f"third tone of {amplitudes}, {SURFACE.frequency_low:g} to {SURFACE.frequency_high:g} Hz"),
        "tones of the surface": Setting(
            f"shifted by {settings.offset_1:g}, {settings.offset_2:g} and {settings.offset_3:g} Hz",
            "against section 2.3, which leaves 200 and 300 Hz as they are",
        ),
    }


def judge_product(three: SubharmonicSpectrum) -> Claim:
    """Whether f2 - f1 is present."""
    product, tones = _size(three, -1, 1), (_size(three, 1, 0), _size(three, 0, 1))
    floor = _floor(three)
    steady, present = three.state == "steady", product > floor
    significant = present and product >= SIGNIFICANT * min(tones)
    return Claim(
        id="product-at-100-hz",
        paper_figure="Fig. 6",
        statement="The response to tones of 200 Hz, 300 Hz and 3 kHz has a significant component at 100 Hz, which a "
        "linear bearing would not make.",
        finding=f"f2 - f1 has {product:.2f} µm, compared with "
        f"{tones[0]:.2f} and {tones[1]:.2f} µm at f1 and f2; the response is {three.state}.",
        verdict="agrees" if steady and significant else "agrees in part" if present else "does not agree",
        reason="There is no steady state."
        if not steady
        else ""
        if significant
        else f"It does not exceed {floor:g} µm, by which lines may differ from block to block."
        if not present
        else f"It is less than {100 * SIGNIFICANT:g} % of the response to the smaller tone.",
        figure="fig6",
    )


def judge_cause(two: SubharmonicSpectrum, three: SubharmonicSpectrum) -> Claim:
    """Whether the third tone causes it."""
    alone, with_third = _size(two, -1, 1), _size(three, -1, 1)
    floor = _floor(three)
    ratio = with_third / max(alone, floor)
    verdict: Answer = "agrees" if ratio > STRONG else "agrees in part" if ratio > 1.2 else "does not agree"
    return Claim(
        id="third-tone-induces",
        paper_figure="Fig. 6",
        statement="It is the third tone that induces the nonlinear behaviour.",
        finding=f"f2 - f1 has {alone:.2f} µm without the third tone and {with_third:.2f} µm with it, {ratio:.1f} times "
        + ("as much." if alone > floor else f"the {floor:g} µm by which lines may differ from block to block."),
        verdict=verdict,
        reason=""
        if verdict == "agrees"
        else f"With the third tone it is not {STRONG:g} times that either."
        if alone <= floor
        else "Two tones are enough: the rotor hangs low under its weight, where force over current and gap is not "
        "symmetric. The third tone changes only the amplitude.",
        figure="fig6",
    )


def judge_slow(three: SubharmonicSpectrum, shifted: SubharmonicSpectrum) -> Claim:
    """Whether there is a small slow component."""
    sizes = [UM * spectrum.slow.amplitude if spectrum.slow else math.nan for spectrum in (three, shifted)]
    present = [size > _floor(three) for size in sizes]
    return Claim(
        id="slow-component",
        paper_figure="Fig. 6",
        statement="There is also a small component of very low frequency, a sign of region C.",
        finding=f"With the paper's tones {_slow(three)}; with shifted ones and a third tone of "
        f"{UM * shifted.settings.inducing_amplitude:g} µm {_slow(shifted)}.",
        verdict="agrees" if present[0] else "agrees in part" if present[1] else "does not agree",
        reason=""
        if present[0]
        else "In steady state all products of the paper's tones are multiples of 100 Hz. A line at "
        f"{PAPER_SLOW:g} Hz, where the paper has it, would follow from the transient in a short record, or by sampling "
        f"({FOLDED}) if the third tone is off by {PAPER_SLOW / 10:g} Hz, between the clocks of generator and "
        "controller.",
        figure="fig6",
    )


def judge_influence(surface: SubharmonicSurface) -> Claim:
    """Whether both amplitude and frequency of the inducing tone influence the slow component."""
    slow = np.where(surface.state == "steady", UM * surface.slow_amplitude, np.nan)
    floor = UM * surface.settings.line_tolerance
    slow = np.maximum(slow, floor)  # a ratio to rounding would be no influence
    over_frequency, over_amplitude = _spread(slow, axis=1), _spread(slow, axis=0)
    strong = [over_frequency > STRONG, over_amplitude > STRONG]
    delevitated = int(np.sum(surface.state == "delevitated"))
    place = np.unravel_index(np.nanargmax(slow), slow.shape) if np.isfinite(slow).any() else None
    largest = (
        ""
        if place is None
        else f" The largest has {slow[place]:.0f} µm at {surface.slow_frequency[place]:.0f} Hz "
        f"({surface.slow_origin[place]}), with a tone of {UM * surface.inducing_amplitude[place[0]]:.0f} µm at "
        f"{surface.inducing_frequency[place[1]]:.0f} Hz."
    )
    return Claim(
        id="inducing-tone-decides",
        paper_figure="Fig. 7",
        statement="Amplitude and frequency of the inducing tone both influence the slow component strongly.",
        finding=f"Largest over smallest slow component, or {floor:g} µm, is {over_frequency:.0f} over the frequencies, "
        f"as the median of the amplitudes, and {over_amplitude:.0f} over the amplitudes, as the median of the "
        f"frequencies. {delevitated} of {slow.size} tones delevitate the rotor.{largest}",
        verdict="agrees" if all(strong) else "agrees in part" if any(strong) else "does not agree",
        reason="The surface has ridges where a harmonic of the tone is close to a multiple of the sample rate: most of "
        "it is sampling, not the bearing.",
        figure="fig7",
    )


def _size(spectrum: SubharmonicSpectrum, a: int, b: int) -> float:
    """Peak amplitude of a product (um); 0 if it was not evaluated."""
    line = spectrum.line(a, b)
    return 0.0 if line is None else UM * abs(line.amplitude)


def _floor(spectrum: SubharmonicSpectrum) -> float:
    """Amplitude up to which a line is not distinguished from none (um)."""
    return UM * spectrum.settings.line_tolerance


def _slow(spectrum: SubharmonicSpectrum) -> str:
    slow = spectrum.slow
    if slow is None:
        return f"the response is {spectrum.state}"
    return f"it has {UM * slow.amplitude:.3f} µm at {slow.frequency:.2f} Hz ({slow.origin})"


def _spread(slow: NDArray[np.float64], axis: int) -> float:
    """Median over the other axis of largest over smallest, if two or more are known; NaN otherwise."""
    lines = slow if axis == 1 else slow.T
    ratios = [np.nanmax(line) / np.nanmin(line) for line in lines if np.isfinite(line).sum() > 1]
    return float(np.median(ratios)) if ratios else math.nan
