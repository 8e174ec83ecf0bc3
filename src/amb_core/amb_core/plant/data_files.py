"""The data files that the parameters of a plant name, by their checksums: results depend on them."""

from __future__ import annotations

import hashlib

from amb_core.ground.files.package_files import located
from amb_core.plant.parameters import PlantParameters


def file_checksums(plant: PlantParameters) -> dict[str, str]:
    """Checksums of the data files of a plant, by path; OSError if one cannot be read."""
    return {
        path: hashlib.sha256(located(path).read_bytes()).hexdigest()
        for path in (plant.iron.bh_table, plant.flexible_rotor.modal_data)
        if path
    }
