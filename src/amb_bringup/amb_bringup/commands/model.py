"""`amb model export`: an identified model for other people's tools."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from amb_bringup.commands.results import make_folder, make_place, new_file
from amb_bringup.commands.terminal import Terminal
from amb_core.ground.errors import IdentificationError

if TYPE_CHECKING:
    from amb_core.identification import StateSpaceModel

app = typer.Typer(help="Export models.", no_args_is_help=True)
ENDINGS = {"mat": ".mat", "fmu": ".fmu", "python": ".py", "julia": ".jl"}


@app.callback()
def model() -> None:
    """Export models."""


@app.command()
def export(
    model: Annotated[Path, typer.Argument(help="Model, as amb identify writes it (.json, .npz or .mat).")],
    mat: Annotated[bool, typer.Option("--mat", help="MATLAB and Octave: ss(A, B, C, D, Ts), idss(...).")] = False,
    c: Annotated[bool, typer.Option("--c", help="C99 without allocation, with a test vector: a folder.")] = False,
    fmu: Annotated[bool, typer.Option("--fmu", help="FMI 2.0 co-simulation, for 64-bit Linux; needs gcc.")] = False,
    python: Annotated[bool, typer.Option("--python", help="Script for python-control.")] = False,
    julia: Annotated[bool, typer.Option("--julia", help="Script for ControlSystems.jl.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write, or folder for --c; by default MODEL.mat and so on, MODEL_c for C."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files of these names.")] = False,
) -> None:
    """Export a model for MATLAB, as C code, as FMU, or for Python or Julia."""
    from amb_core.identification import StateSpaceModel

    chosen = {"mat": mat, "c": c, "fmu": fmu, "python": python, "julia": julia}
    formats = [name for name, wanted in chosen.items() if wanted]
    if len(formats) != 1:
        raise IdentificationError(f"give one format: {', '.join(f'--{name}' for name in chosen)}")
    console, loaded = Terminal(), StateSpaceModel.load(model)
    if c:
        written = _write_c(loaded, model.stem, out or model.with_name(f"{model.stem}_c"), overwrite)
    else:
        written = [_write_file(loaded, formats[0], out or model.with_suffix(ENDINGS[formats[0]]), overwrite)]
    for path in written:
        console.print(f"written: {path}", highlight=False, markup=False, soft_wrap=True)


def _write_file(model: StateSpaceModel, form: str, path: Path, overwrite: bool) -> Path:
    from amb_core.recording.export.fmu import write_fmu
    from amb_core.recording.export.model_texts import julia_text, python_text

    make_place(path, (ENDINGS[form],))
    with new_file(path, overwrite) as part:
        if form == "mat":
            model.save(part)
        elif form == "fmu":
            write_fmu(model, part, path.stem)
        else:
            part.write_text(python_text(model) if form == "python" else julia_text(model), encoding="utf-8")
    return path


def _write_c(model: StateSpaceModel, label: str, folder: Path, overwrite: bool) -> list[Path]:
    from amb_core.recording.export.model_texts import c_texts, identifier

    texts = c_texts(model, identifier(label))
    make_folder(folder)
    with ExitStack() as files:
        for name, text in texts.items():
            files.enter_context(new_file(folder / name, overwrite)).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]
