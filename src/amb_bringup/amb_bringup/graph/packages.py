"""Finds executables and shared files of built packages in the ament index, with clear error messages."""

from __future__ import annotations

import os
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

import amb_controller_node
import amb_ident_node
import amb_ros
import amb_sim_node
from amb_core.ground.errors import AmbError

NODE_PACKAGES = (amb_ros, amb_sim_node, amb_controller_node, amb_ident_node)
"""The packages that the processes of a graph run."""


class LaunchError(AmbError):
    """A package, executable or launch file cannot be found, read or started."""


def package_prefix(package: str) -> Path:
    """Folder into which a package is installed.

    Raises
    ------
    LaunchError
        If no such package is known to the environment.
    """
    try:
        return Path(get_package_prefix(package))
    except (PackageNotFoundError, ValueError):
        raise LaunchError(
            f"package '{package}' is not found; build the workspace (make setup) and source scripts/env.sh"
        ) from None
    except KeyError:
        raise LaunchError("AMENT_PREFIX_PATH is not set; source scripts/env.sh, or a ROS 2 installation") from None


def share_folder(package: str) -> Path:
    """Folder of the launch and parameter files of a package; raises `LaunchError` as `package_prefix` does."""
    return package_prefix(package) / "share" / package


def find_executable(package: str, executable: str) -> Path:
    """Path of an executable as `ros2 run` finds it.

    Raises
    ------
    LaunchError
        If there is no such package or executable; the message lists the available executables.
    """
    folder = package_prefix(package) / "lib" / package
    path = folder / executable
    if path.is_file() and os.access(path, os.X_OK):
        return path
    there = sorted(p.name for p in folder.glob("*") if p.is_file() and os.access(p, os.X_OK))
    raise LaunchError(
        f"package '{package}' has no executable '{executable}'; it has: {', '.join(there) or 'none at all'}"
    )
