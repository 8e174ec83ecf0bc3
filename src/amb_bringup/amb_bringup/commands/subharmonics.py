"""`amb subharmonics`: products of three tones in a nonlinear bearing (paper, Fig. 6 and 7)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.inputs import load_loop
from amb_bringup.commands.options import ParamsOption, declared_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_core.ground.errors import ParameterError, SpectrumError
from amb_core.ground.parameters import part_of
from amb_core.ground.progress import as_stage
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.simulation.parameters import with_values
from amb_core.recording import Recording
from amb_core.regions.subharmonics import (
    VARIANTS,
    Line,
    SubharmonicSettings,
    SubharmonicSpectrum,
    SubharmonicSurface,
    SurfaceSettings,
    analyse,
    run_subharmonics,
    subharmonic_surface,
)
from amb_core.regions.subharmonics.run import check
from amb_core.regions.subharmonics.summary import spectrum_summary, surface_summary

SHOWN = 12  # lines in a table
DIFFERENCE = (-1, 1, 0)  # f2 - f1
TONE_ERROR = 0.1  # of its amplitude, by which a recorded tone may differ from the requested one
RIVAL = 4  # a product whose order is higher than another's by up to this much may still cause their common line


@declared_options({"Tones": [SubharmonicSettings], "Surface": [SurfaceSettings]}, leave_out=["shifted"])
def subharmonics(
    given: dict[str, Any],
    params: ParamsOption = None,
    bag: Annotated[
        Path | None, typer.Option(help="Bag whose last experiment is analysed; nothing is simulated.")
    ] = None,
    causes: Annotated[
        bool, typer.Option("--causes", help="Repeat both tests with one effect of the loop switched off at a time.")
    ] = False,
    surface: Annotated[
        bool, typer.Option("--surface", help="Repeat both tests over amplitude and frequency of the inducing tone.")
    ] = False,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a running dask scheduler, tls://host:port, to run the surface.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine to run the surface; one per core if not given.")
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(help="Surface: folder of finished runs, instead of ~/.cache/amb/subharmonics.", file_okay=False),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for summary.json and figures.")] = Path("results/subharmonics"),
) -> None:
    """Add three tones to the reference and find their products in the steady state of the position.

    The test runs twice, as given and with shifted tones. This separates coinciding products, and shows those of
    sampling.

    Finished runs of a surface are kept, like the sweeps of `amb map`.
    """
    settings, grid = part_of(SubharmonicSettings, given), part_of(SurfaceSettings, given)
    if bag is not None and (causes or surface or params is not None):
        raise ParameterError("--bag analyses what was measured; it takes no --params, --set, --causes or --surface")
    console = Terminal()
    make_folder(out)
    if bag is not None:
        results = {"bag": {"measured": _analyse_bag(bag, settings)}}
    else:
        loop = load_loop(params)
        with Stages(console) as stages:
            results = _simulate(stages, *loop, settings, causes)
    for name, tests in results.items():
        for test, spectrum in tests.items():
            console.print(_table(f"{name}, {test}", spectrum))
    if causes:
        console.print(_cause_table(results))
    _write_spectra(out, results)
    if surface:  # after the spectra are written: it takes minutes, and its scheduler may not be available
        with Stages(console) as stages:
            surfaces = _surfaces(stages, *loop, settings, grid, cache=cache, scheduler=scheduler, workers=workers)
        for name, computed in surfaces.items():
            console.print(_surface_line(name, computed))
        _write_surfaces(out, results, surfaces)
    console.print(f"summary.json, figures: {out}")


def _analyse_bag(bag: Path, settings: SubharmonicSettings) -> SubharmonicSpectrum:
    """Spectrum of the last experiment of a bag after the time of the fade-in; refused if it lacks the tones."""
    record = Recording.read(bag).experiment(-1, 0)
    first = record.first_step + round(settings.fade_in / record.sample_time)
    reference = analyse(replace(record, position=record.reference), settings, first)
    for tone, (frequency, asked) in enumerate(zip(settings.frequencies, settings.amplitudes, strict=True)):
        line = reference.line(*(int(tone == index) for index in range(3)))
        amplitude = 0.0 if line is None else abs(line.amplitude)
        if abs(amplitude - asked) > TONE_ERROR * asked:
            raise SpectrumError(
                f"bag {bag}: the reference {settings.axis} has {UM * amplitude:.3g} um at {frequency:g} Hz, requested: "
                f"{UM * asked:.3g} um; specify the recorded tones"
            )
    return analyse(record, settings, first)


def _simulate(
    stages: Stages,
    plant: PlantParameters,
    controller: ControllerParameters,
    settings: SubharmonicSettings,
    causes: bool,
) -> dict[str, dict[str, SubharmonicSpectrum]]:
    """Spectra by loop and test: for the loop as given and, optionally, with one effect switched off at a time."""
    variants = VARIANTS if causes else VARIANTS[:1]
    tests = {"as asked": settings, "shifted": settings.shifted()}
    loops = {variant.name: with_values(plant, controller, variant.values) for variant in variants}
    for loop in loops.values():
        for test in tests.values():
            check(*loop, test)  # all before the first run
    done, total = 0, len(loops) * len(tests)
    results: dict[str, dict[str, SubharmonicSpectrum]] = {}
    for variant, loop in loops.items():
        results[variant] = {}
        for name, test in tests.items():
            stages.update("spectra", done, total, f"{variant}, {name}")
            results[variant][name] = run_subharmonics(*loop, test)
            done += 1
    stages.update("spectra", done, total)
    return results


def _surfaces(
    stages: Stages,
    plant: PlantParameters,
    controller: ControllerParameters,
    settings: SubharmonicSettings,
    grid: SurfaceSettings,
    **cluster: Any,
) -> dict[str, SubharmonicSurface]:
    """The surface as requested, and shifted."""
    surfaces = {}
    for name, shifted in (("surface", False), ("surface_shifted", True)):
        stages.update(name)
        surfaces[name] = subharmonic_surface(
            plant,
            controller,
            settings,
            grid.model_copy(update={"shifted": shifted}),
            **cluster,
            progress=as_stage(name, stages.update),
        )
    return surfaces


def _write_spectra(out: Path, results: dict[str, dict[str, SubharmonicSpectrum]]) -> None:
    """Summary, and the figure of the spectra of the loop as given."""
    from amb_core.report.figures import spectrum_chart

    _write_summary(out, results, {})
    given = next(iter(results.values()))
    spectrum_chart(given).save(out, "spectrum")


def _write_surfaces(
    out: Path, results: dict[str, dict[str, SubharmonicSpectrum]], surfaces: dict[str, SubharmonicSurface]
) -> None:
    """Summary with the surfaces, and their figures."""
    from amb_core.report.figures import surface_chart

    _write_summary(out, results, surfaces)
    for name, surface in surfaces.items():
        surface_chart(surface).save(out, name)


def _write_summary(
    out: Path, results: dict[str, dict[str, SubharmonicSpectrum]], surfaces: dict[str, SubharmonicSurface]
) -> None:

    spectra = {
        name: {test: spectrum_summary(spectrum) for test, spectrum in tests.items()} for name, tests in results.items()
    }
    summaries = {name: surface_summary(surface) for name, surface in surfaces.items()}
    write_json(out / "summary.json", {"spectra": spectra, "surfaces": summaries})


def _table(title: str, spectrum: SubharmonicSpectrum) -> Table:
    """The largest lines of a spectrum."""
    colour = "green" if spectrum.state == "steady" else "yellow"
    table = Table(
        "frequency (Hz)", "amplitude (um)", "product", "made by", "also there",
        title=title, caption=Text.assemble((spectrum.state, colour), f": {spectrum.reason}{_slow(spectrum)}"),
    )  # fmt: skip
    for column in table.columns[:2]:
        column.justify = "right"
    table.columns[2].no_wrap = True
    for line in sorted(spectrum.lines, key=lambda line: -abs(line.amplitude))[:SHOWN]:
        table.add_row(
            f"{line.frequency:.2f}",
            f"{UM * abs(line.amplitude):.4f}",
            line.product.label,
            _origin(line),
            ", ".join(other.label for other in line.products[1:3]),
        )
    return table


def _origin(line: Line) -> str:
    """Origin of a line, as far as the orders of its products show it."""
    if line.product.order == 1:
        return "tone"
    folded = {product.folds != 0 for product in line.products if product.order <= line.product.order + RIVAL}
    return "loop or sampling" if len(folded) > 1 else "sampling" if folded.pop() else "loop"


def _slow(spectrum: SubharmonicSpectrum) -> str:
    slow = spectrum.slow
    if slow is None:
        return ""
    return (
        f"; bias {UM * spectrum.bias:.2f} um, slow component {UM * slow.amplitude:.4f} um at {slow.frequency:.2f} Hz "
        f"({slow.origin}), the loop's own motion {UM * spectrum.own:.4f} um rms"
    )


def _cause_table(results: dict[str, dict[str, SubharmonicSpectrum]]) -> Table:
    """f2 - f1 and the slow component, loop by loop."""
    table = Table("loop", "test", "state", "bias (um)", "f2 - f1 (um)", "slow (um)", "at (Hz)", "made by")
    for name, tests in results.items():
        for test, spectrum in tests.items():
            line, slow = spectrum.line(*DIFFERENCE), spectrum.slow
            if slow is None:
                table.add_row(name, test, spectrum.state)
                continue
            table.add_row(
                name, test, spectrum.state, f"{UM * spectrum.bias:.1f}",
                "" if line is None else f"{UM * abs(line.amplitude):.3f}",
                f"{UM * slow.amplitude:.3f}", f"{slow.frequency:.2f}", slow.origin,
            )  # fmt: skip
    return table


def _surface_line(name: str, surface: SubharmonicSurface) -> str:
    """Number of runs per result, and the largest slow component."""
    states, counts = np.unique(surface.state, return_counts=True)
    ended = ", ".join(f"{count} {state}" for state, count in zip(states, counts, strict=True))
    steady = np.where(surface.state == "steady", surface.slow_amplitude, np.nan)
    if np.isnan(steady).all():
        return f"{name}: {ended}"
    i, j = np.unravel_index(np.nanargmax(steady), steady.shape)
    return (
        f"{name}: {ended}; largest slow component in steady state {UM * steady[i, j]:.3f} um at "
        f"{surface.slow_frequency[i, j]:.2f} Hz ({surface.slow_origin[i, j]}), inducing tone "
        f"{UM * surface.inducing_amplitude[i]:.1f} um at {surface.inducing_frequency[j]:g} Hz"
    )
