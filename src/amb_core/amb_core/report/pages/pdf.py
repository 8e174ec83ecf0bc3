"""A page as a PDF, printed by a browser that is installed: to be signed, filed or sent."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from amb_core.ground.errors import AmbError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
"""Programs that print without a window, in the order in which they are looked for."""

TIMEOUT = 180.0  # s; a page takes some seconds


def find_browser() -> str:
    """The browser that prints pages.

    Returns
    -------
    str
        Path of the program.

    Raises
    ------
    AmbError
        If there is none of `BROWSERS`.
    """
    for name in BROWSERS:
        if path := shutil.which(name):
            return path
    raise AmbError(
        f"a PDF needs one of the browsers {', '.join(BROWSERS)}, and none is installed; install one (Debian, Ubuntu: "
        "sudo apt-get install chromium), or leave out --pdf and print the page from any browser"
    )


def write_pdf(page: str | Path, browser: str | None = None) -> Path:
    """Print a page of `write_report` as a PDF beside it.

    Parameters
    ----------
    page : str or Path
        The page.
    browser : str, optional
        Path of the browser; by default that of `find_browser`.

    Returns
    -------
    Path
        The PDF, named as the page.

    Raises
    ------
    AmbError
        If there is no browser, or it prints nothing.
    """
    program, source = browser or find_browser(), Path(page).resolve()
    target = source.with_suffix(".pdf")
    with tempfile.TemporaryDirectory() as folder:
        printed = Path(folder) / "page.pdf"
        command = [
            program, "--headless", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer",
            f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}", source.as_uri(),
        ]  # fmt: skip
        if os.geteuid() == 0:
            command.insert(1, "--no-sandbox")  # Chromium refuses to run as root with it
        try:
            ended = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
        except (OSError, subprocess.TimeoutExpired) as problem:
            raise AmbError(f"{target.name}: {program} did not print {source}: {problem}") from None
        if not printed.exists():
            last = ended.stderr.strip().splitlines()[-1:] or ["no message"]
            raise AmbError(f"{target.name}: {program} did not print {source}: {last[0]}")
        try:
            shutil.copyfile(printed, target)
        except OSError as problem:
            raise AmbError(f"{target}: cannot be written: {problem.strerror}") from None
    return target
