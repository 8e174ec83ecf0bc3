"""SHA-256 of what a certificate rests on: files, folders, and models, data and controllers that are in no file."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import RobustnessError
from amb_core.ground.given_values import path_of
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController, LinearControl


def sha256_of(path: str | Path) -> str:
    """SHA-256 of a file, as `sha256sum` prints it; of a folder that of the names and SHA-256 of all its files.

    Parameters
    ----------
    path : str or Path
        File or folder.

    Returns
    -------
    str
        Hexadecimal digits.

    Raises
    ------
    RobustnessError
        If it cannot be read.
    """
    place, digest = path_of("path", path, RobustnessError), hashlib.sha256()
    try:
        if not place.is_dir():
            return _of_file(place).hex()
        for file in sorted(item for item in place.rglob("*") if item.is_file()):
            digest.update(str(file.relative_to(place)).encode())
            digest.update(_of_file(file))
    except OSError as problem:
        raise RobustnessError(f"{place}: cannot be read: {problem.strerror}") from None
    return digest.hexdigest()


def _of_file(file: Path) -> bytes:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").digest()


def sha256_of_model(model: StateSpaceModel) -> str:
    """SHA-256 of the matrices of a model that is in no file, and of its sample time.

    Parameters
    ----------
    model : StateSpaceModel
        The model.

    Returns
    -------
    str
        Hexadecimal digits.
    """
    arrays = (model.a, model.b, model.c, model.d, model.k, model.innovation_covariance, np.array(model.sample_time))
    return _sha256(arrays)


def sha256_of_data(data: IdentificationData) -> str:
    """SHA-256 of the samples of data that are in no file, and of their sample time.

    Parameters
    ----------
    data : IdentificationData
        Data of any plant.

    Returns
    -------
    str
        Hexadecimal digits.
    """
    signals = [
        signal
        for item in data.experiments
        for signal in (item.inputs, item.outputs, item.reference)
        if signal is not None
    ]
    return _sha256((*signals, np.array(data.sample_time)))


def sha256_of_controller(controller: KnownController) -> str:
    """SHA-256 of a controller that is in no file: of its matrices, or of its parameters as JSON.

    Parameters
    ----------
    controller : KnownController
        PD or linear controller.

    Returns
    -------
    str
        Hexadecimal digits.
    """
    if isinstance(controller, LinearControl):
        return sha256_of_model(controller.model)
    return hashlib.sha256(json.dumps(controller.model_dump(), sort_keys=True).encode()).hexdigest()


def _sha256(arrays: tuple[np.ndarray, ...]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.shape}".encode())
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()
