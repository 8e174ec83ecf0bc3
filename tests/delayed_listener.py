"""A middleware that begins late to listen at an end point, as where a busy machine takes the processor away there."""

from __future__ import annotations

import subprocess
from pathlib import Path

SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <unistd.h>

#define NAME _ZN8eprosima7fastdds3dds10DataReader12set_listenerEPNS1_18DataReaderListenerERKNS1_10StatusMaskE
#define TEXT_OF(name) #name
#define TEXT(name) TEXT_OF(name)

int NAME(void *reader, void *listener, const void *mask)
{
    int (*next)(void *, void *, const void *);
    *(void **)&next = dlsym(dlopen("libfastrtps.so.2.14", RTLD_NOW), TEXT(NAME));
    usleep(1000u * (unsigned)atoi(getenv("LISTENER_DELAY_MS")));
    return next(reader, listener, mask);
}
"""


def delayed_listener(folder: Path, delay: float) -> dict[str, str]:
    """Environment of processes whose middleware listens so much later (s), by a library that is built in a folder."""
    library = folder / "delayed_listener.so"
    compiler = ["cc", "-O1", "-shared", "-fPIC", "-x", "c", "-", "-o", str(library), "-ldl"]
    subprocess.run(compiler, input=SOURCE, text=True, check=True)
    return {"LD_PRELOAD": str(library), "LISTENER_DELAY_MS": f"{1e3 * delay:.0f}"}
