"""The correction of waits whose time limit overflows: which libraries it concerns, and what it changes in them."""

from __future__ import annotations

import contextlib
import errno
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import pytest

from amb_ros import corrected_calls, overflowed_wait

LIBRARY = """
#include <errno.h>
#include <pthread.h>
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t condition = PTHREAD_COND_INITIALIZER;
static void *wake(void *unused) {
    pthread_mutex_lock(&mutex);  /* free once the other thread waits */
    pthread_cond_signal(&condition);
    pthread_mutex_unlock(&mutex);
    return unused;
}
int wait_until(long seconds, long nanoseconds) {
    struct timespec limit = {seconds, nanoseconds};
    pthread_t thread;
    pthread_mutex_lock(&mutex);
    if (seconds < 0) pthread_create(&thread, 0, wake, 0);
    int answer = pthread_cond_timedwait(&condition, &mutex, &limit);
    pthread_mutex_unlock(&mutex);
    if (seconds < 0) pthread_join(thread, 0);
    return answer;
}
"""
NEWER = "int newer(void *c, void *m, void *t) { return pthread_cond_clockwait(c, m, 1, t); }"
CORRECTED = """
import ctypes, sys
from amb_ros import overflowed_wait
wait_until = ctypes.CDLL(sys.argv[1]).wait_until
wait_until.argtypes = ctypes.c_long, ctypes.c_long
before = [wait_until(-7, -5), wait_until(7, 0)] if sys.argv[2] else []
lines = [line.split() for line in open("/proc/self/maps") if sys.argv[1] in line]
overflowed_wait.correct_at(int(lines[0][0].partition("-")[0], 16))
print(before, [wait_until(-7, -5), wait_until(7, 0)])
"""


def compiled(folder: Path, code: str, *options: str) -> Path:
    source, library = folder / "library.c", folder / "libfastrtps.so.9"
    source.write_text(code)
    command = ["gcc", "-w", "-shared", "-fPIC", "-D_GNU_SOURCE", *options, "-o", str(library), str(source)]
    subprocess.run(command, check=True)
    return library


@pytest.mark.parametrize("called_before", [True, False])
@pytest.mark.parametrize(
    "options", [["-Wl,-z,lazy"], ["-Wl,-z,now,-z,relro"], ["-fno-plt", "-Wl,-z,now,-z,relro"]], ids=" ".join
)
def test_an_overflowed_limit_is_none_and_others_stay(tmp_path: Path, options: list[str], called_before: bool) -> None:
    library = compiled(tmp_path, LIBRARY, *options)
    command = [sys.executable, "-c", CORRECTED, str(library), "before" if called_before else ""]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    before = [errno.EINVAL, errno.ETIMEDOUT] if called_before else []
    assert said == f"{before} {[0, errno.ETIMEDOUT]}\n"


def test_only_a_library_that_lacks_the_newer_call_has_the_fault(tmp_path: Path) -> None:
    assert overflowed_wait.has_fault(compiled(tmp_path, LIBRARY))
    assert not overflowed_wait.has_fault(compiled(tmp_path, LIBRARY + NEWER))
    assert not overflowed_wait.has_fault(compiled(tmp_path, "int nothing;"))


@pytest.fixture
def uncorrected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library with the fault, as the only one of a process that has not been corrected."""
    library = compiled(tmp_path, LIBRARY)
    monkeypatch.setattr(overflowed_wait, "loaded_libraries", lambda *_: [(library, 0)])
    monkeypatch.setattr(overflowed_wait, "correct", corrected_calls.once(overflowed_wait._correct))
    return library


def test_two_threads_at_once_correct_a_process_once(uncorrected: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    corrected: list[int] = []
    both = threading.Barrier(2)

    def correct_at(address: int) -> None:
        corrected.append(address)
        with contextlib.suppress(threading.BrokenBarrierError):
            both.wait(0.5)  # for the other thread, which must not come here

    monkeypatch.setattr(overflowed_wait, "correct_at", correct_at)
    threads = [threading.Thread(target=overflowed_wait.correct) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert corrected == [0]


def test_a_cache_folder_that_is_not_absolute_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    assert corrected_calls.build().parent == tmp_path / "home" / ".cache" / "amb"
    assert not (tmp_path / "cache").exists()


def test_without_a_compiler_there_is_one_warning(
    uncorrected: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PATH", "")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        overflowed_wait.correct()
        overflowed_wait.correct()
    assert [str(item.message).partition(" has a fault")[0] for item in warned] == [str(uncorrected)]
    assert "gcc" in str(warned[0].message)
