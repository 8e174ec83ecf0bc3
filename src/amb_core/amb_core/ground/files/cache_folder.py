"""The folder in which a user keeps what can be made again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder(subject: str = "") -> Path:
    """Folder of results for this user: amb/<subject> in the cache folder of the XDG base directories.

    Parameters
    ----------
    subject : str, optional
        Name of the kind of results; none by default.

    Returns
    -------
    Path
        The folder, whether it exists or not.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not cache.is_absolute():  # to be ignored, says the specification
        cache = Path.home() / ".cache"
    return cache / "amb" / subject
