"""Files that belong to a built package: `package://NAME/PATH` is PATH in the shared folder of the package NAME.

This is how robot descriptions name their files (URDF, resource_retriever), so that a parameter file and the files
beside it work from any working directory. Packages are found as ament finds them: in the first folder of
AMENT_PREFIX_PATH whose index lists the package. Source: REP 122 (installed layout), ament_index.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

SCHEME = "package://"


def located(path: str | Path) -> Path:
    """The file that a path names: itself, or with `package://` in front one of a package.

    Raises
    ------
    OSError
        If there is no such package; its `strerror` gives the reason.
    """
    text = str(path)
    if not text.startswith(SCHEME):
        return Path(path)
    package, _, rest = text.removeprefix(SCHEME).partition("/")
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if package and (Path(prefix) / "share" / "ament_index" / "resource_index" / "packages" / package).is_file():
            return Path(prefix) / "share" / package / rest
    raise OSError(
        errno.ENOENT, f"package '{package}' is not found in AMENT_PREFIX_PATH; build and source the workspace"
    )
