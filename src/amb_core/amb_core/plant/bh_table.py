"""Magnetisation curves from files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.ground.files.package_files import located
from amb_core.ground.files.regular_files import read_text, shown

_LARGEST = 5.0  # T


def read_bh_table(path: str | Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a magnetisation curve: CSV with columns field H (A/m) and flux density B (T), from 0, 0 upwards.

    The first line may be a header; empty lines and lines that begin with # are skipped.

    Parameters
    ----------
    path : str or Path
        The file; `package://PACKAGE/PATH` for one in the shared folder of a package.

    Returns
    -------
    field, flux_density : ndarray, shape (n,)
        H (A/m), B (T).

    Raises
    ------
    PlantError
        If the file cannot be read, is not such a table, or the curve is not physical; gives the file and the line.
    """
    try:
        lines = read_text(located(path)).splitlines()
    except OSError as problem:
        raise PlantError(
            f"bh_table {shown(path)} cannot be read: {problem.strerror}; allowed: a CSV file of H (A/m), B (T)"
        ) from None
    numbers: list[int] = []
    points: list[tuple[float, float]] = []
    for number, cells in enumerate(csv.reader(lines), start=1):
        if not "".join(cells).strip() or cells[0].lstrip().startswith("#"):
            continue
        if len(cells) != 2:
            raise PlantError(f"bh_table {path}, line {number}: {len(cells)} columns; allowed: two, H (A/m) and B (T)")
        try:
            point = float(cells[0]), float(cells[1])
        except ValueError:
            if not points and number == 1:
                continue  # header
            raise PlantError(f"bh_table {path}, line {number}: '{','.join(cells)}'; allowed: two numbers") from None
        numbers.append(number)
        points.append(point)
    table = np.array(points, dtype=np.float64).reshape(-1, 2)
    _check(path, numbers, table)
    return table[:, 0], table[:, 1]


def _check(path: str | Path, numbers: list[int], table: NDArray[np.float64]) -> None:
    if len(table) < 3:
        raise PlantError(f"bh_table {path}: {len(table)} points; allowed: 3 or more")
    if np.any(table[0] != 0.0):
        raise PlantError(
            f"bh_table {path}, line {numbers[0]}: the curve begins at H = {table[0, 0]:g} A/m, B = {table[0, 1]:g} T; "
            "allowed: 0, 0"
        )
    for number, (field, flux_density), (past_field, past_flux_density) in zip(
        numbers[1:], table[1:], table[:-1], strict=True
    ):
        where = f"bh_table {path}, line {number}: "
        if not (np.isfinite(field) and np.isfinite(flux_density)):
            raise PlantError(f"{where}H = {field:g} A/m, B = {flux_density:g} T; allowed: finite numbers")
        if field <= past_field or flux_density <= past_flux_density:
            raise PlantError(
                f"{where}H = {field:g} A/m, B = {flux_density:g} T after {past_field:g} A/m, {past_flux_density:g} T; "
                "allowed: both rise from line to line"
            )
        slope = (flux_density - past_flux_density) / (field - past_field)
        if slope < mu_0:
            raise PlantError(f"{where}slope dB/dH = {slope:.4g} H/m; allowed: mu0 = {mu_0:.4g} H/m or more, as in air")
        if flux_density > _LARGEST:
            raise PlantError(f"{where}B = {flux_density:g} T; allowed: {_LARGEST:g} T or less")
