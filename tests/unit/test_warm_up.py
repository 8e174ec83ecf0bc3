"""The set-up compiles every kernel: a node that compiles one later stands still meanwhile, and answers nobody."""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import NullCache
from numba.core.registry import CPUDispatcher

import amb_core


@pytest.mark.slow
@pytest.mark.timeout(1200)  # it compiles every kernel, beside whatever else runs
def test_warming_up_compiles_every_kernel_that_is_kept_in_the_cache(tmp_path: Path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-m", "amb_core.warm_up"], env=environment, check=True)

    compiled = {file.name.split("-")[0] for file in tmp_path.rglob("*.nbi")}

    assert cached_kernels() - compiled == set()


def cached_kernels() -> set[str]:
    """Kernels of amb_core that numba keeps in its cache, as module.function without packages."""
    kernels = set()
    for module in pkgutil.walk_packages(amb_core.__path__, "amb_core."):
        for name, kernel in vars(importlib.import_module(module.name)).items():
            own = isinstance(kernel, CPUDispatcher) and kernel.py_func.__module__ == module.name
            if own and not isinstance(kernel._cache, NullCache):
                kernels.add(f"{module.name.rsplit('.', 1)[-1]}.{name}")
    return kernels
