"""A model as functional mock-up unit (FMU) for co-simulation, FMI 2.0.4: description, C code and a library for Linux.

The library is compiled with gcc from the same C code as the export in C. Source: FMI 2.0.4 for Model Exchange and
Co-Simulation, Modelica Association, 2022.
"""

from __future__ import annotations

import subprocess
import uuid
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from amb_core.ground.errors import IdentificationError
from amb_core.ground.plain_text import plain_text
from amb_core.linear.model import StateSpaceModel
from amb_core.recording.export.model_texts import c_texts, identifier, rendered, title_of

COMPILER = ("gcc", "-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden", "-shared", "-Wl,-z,defs")
BASE_UNITS = {
    "A": 'A="1"', "m": 'm="1"', "s": 's="1"', "kg": 'kg="1"', "N": 'kg="1" m="1" s="-2"', "rad": 'rad="1"',
    "V": 'kg="1" m="2" s="-3" A="-1"', "m/s": 'm="1" s="-1"', "rad/s": 'rad="1" s="-1"', "Pa": 'kg="1" m="-1" s="-2"',
    "um": 'm="1" factor="1e-6"', "mm": 'm="1" factor="1e-3"', "mA": 'A="1" factor="1e-3"',
}  # fmt: skip
"""What units are in base units of SI, as attributes of the description; others stand there by name alone."""
_DATE = (1980, 1, 1, 0, 0, 0)  # of files in the archive: the same model gives the same bytes


def write_fmu(model: StateSpaceModel, path: Path, label: str = "") -> None:
    """Write a model as FMU.

    Parameters
    ----------
    model : StateSpaceModel
        The model. Its inputs start at the operating point.
    path : Path
        The `.fmu` file.
    label : str, optional
        Name of the model; by default that of the file.

    Raises
    ------
    IdentificationError
        If two variables have one name, there is no gcc, or the code does not compile.
    OSError
        If the file cannot be written.
    """
    label = label or path.stem
    name = identifier(label)
    _require_different(model)
    texts = {file: text for file, text in c_texts(model, name).items() if file != f"{name}_check.c"}
    guid = "{" + str(uuid.uuid5(uuid.NAMESPACE_OID, "".join(texts.values()))) + "}"
    offsets = [repr(value) for value in model.input_offset.tolist()]
    values = {"name": name, "NAME": name.upper(), "title": title_of(model), "guid": guid, "input_offset": offsets}
    texts[f"{name}_fmu.c"] = rendered("fmu.c.j2", values)
    content = {"modelDescription.xml": plain_text(_description(model, values | {"label": label})).encode()}
    content |= {f"sources/{file}": text.encode() for file, text in texts.items()}
    content[f"binaries/linux64/{name}.so"] = _library(name, texts)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, data in content.items():
            archive.writestr(zipfile.ZipInfo(file, _DATE), data, zipfile.ZIP_DEFLATED)


def _description(model: StateSpaceModel, values: dict[str, Any]) -> str:
    """The file modelDescription.xml."""
    inputs = zip(model.input_names, model.input_units, values["input_offset"], strict=True)
    outputs = ((name, unit, None) for name, unit in zip(model.output_names, model.output_units, strict=True))
    units = dict.fromkeys(unit for unit in (*model.input_units, *model.output_units) if unit)
    first = len(model.input_names) + 1  # variables count from 1
    dependencies = [
        (first + row, " ".join(str(column + 1) for column, gain in enumerate(gains) if gain))
        for row, gains in enumerate(model.d.tolist())
    ]
    return rendered(
        "model_description.xml.j2",
        values
        | {
            "sample_time": repr(model.sample_time),
            "variables": [*inputs, *outputs],
            "units": [(unit, BASE_UNITS.get(unit, "")) for unit in units],
            "dependencies": dependencies,
        },
    )


def _require_different(model: StateSpaceModel) -> None:
    names = [*model.input_names, *model.output_names]
    if len(set(names)) < len(names):
        raise IdentificationError(f"variables of an FMU need names of their own; there are {', '.join(names)}")


def _library(name: str, texts: dict[str, str]) -> bytes:
    """The shared library of the code."""
    with TemporaryDirectory(prefix="amb-") as place:
        folder = Path(place)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
        library = folder / f"{name}.so"
        sources = [str(folder / file) for file in texts if file.endswith(".c")]
        try:
            subprocess.run([*COMPILER, "-o", str(library), *sources, "-lm"], check=True, capture_output=True, text=True)
        except FileNotFoundError:
            raise IdentificationError("an FMU needs the compiler gcc (Debian or Ubuntu: apt install gcc)") from None
        except subprocess.CalledProcessError as problem:
            raise IdentificationError(f"the code of the model does not compile: {problem.stderr.strip()}") from None
        return library.read_bytes()
