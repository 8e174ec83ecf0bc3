"""A disk that stalls: in a process with this library preloaded, writes to bags wait as long as a file exists."""

from __future__ import annotations

import subprocess
from collections.abc import MutableMapping
from pathlib import Path

SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int is_of_a_bag(int file)
{
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path);
    return length > 5 && memcmp(path + length - 5, ".mcap", 5) == 0;
}

ssize_t write(int file, const void *data, size_t size)
{
    static ssize_t (*next)(int, const void *, size_t);
    if (next == NULL)
        *(void **)&next = dlsym(RTLD_NEXT, "write");
    if (is_of_a_bag(file))
        while (access(getenv("STALLED_WHILE"), F_OK) == 0)
            usleep(1000);
    return next(file, data, size);
}
"""


class StallingDisk:
    """Holds up the writes of processes that are started in an environment.

    Parameters
    ----------
    folder : Path
        For the library and the file.
    environment : mutable mapping
        Of these processes.
    """

    def __init__(self, folder: Path, environment: MutableMapping[str, str]) -> None:
        library, self._stalled = folder / "stalling.so", folder / "stalled"
        compiler = ["cc", "-O1", "-shared", "-fPIC", "-x", "c", "-", "-o", str(library), "-ldl"]
        subprocess.run(compiler, input=SOURCE, text=True, check=True)
        environment |= {"LD_PRELOAD": str(library), "STALLED_WHILE": str(self._stalled)}

    def stall(self) -> None:
        """From now on a write to a bag does not return."""
        self._stalled.touch()

    def resume(self) -> None:
        """Let the writes go on."""
        self._stalled.unlink(missing_ok=True)
