"""Real-time options: what the machine allows is done, the rest is reported with how to allow it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.loop.real_time import RealTimeParameters, enter_real_time, processors_of

WITHOUT_RIGHTS = """
import os, resource
from amb_core.loop.real_time import RealTimeParameters, enter_real_time
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
if os.getuid() == 0:
    os.setuid(65534)
print(enter_real_time(RealTimeParameters(priority=50, lock_memory=True)))
print(os.sched_getscheduler(0) == os.SCHED_OTHER)
"""


def test_processors_are_given_as_numbers_and_ranges() -> None:
    assert processors_of("") == set()
    assert processors_of("3") == {3}
    assert processors_of("2-4, 7") == {2, 3, 4, 7}


@pytest.mark.parametrize("text", ["x", "-1", "1-", "2 to 3"])
def test_what_names_no_processors_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match=r"processors = .* is not allowed; allowed: numbers such as '2-3,5'"):
        validate(RealTimeParameters, {"processors": text})


def in_a_thread(parameters: RealTimeParameters) -> tuple[str, set[int]]:
    """What was not possible for a thread, and its processors afterwards."""
    results = []

    def enter() -> None:
        results.append((enter_real_time(parameters), os.sched_getaffinity(0)))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    return results[0]


def test_only_the_calling_thread_is_bound_to_its_processors() -> None:
    allowed = os.sched_getaffinity(0)
    one = max(allowed)
    assert in_a_thread(RealTimeParameters(processors=str(one))) == ("", {one})
    assert os.sched_getaffinity(0) == allowed


def test_processors_that_are_not_there_are_named_with_those_that_are() -> None:
    problem, processors = in_a_thread(RealTimeParameters(processors="9999"))
    assert problem.startswith("real_time.processors = 9999: not available; allowed here: ")
    assert processors == os.sched_getaffinity(0)


def test_what_is_not_permitted_is_reported_in_one_line_with_the_remedy() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_RIGHTS], capture_output=True, text=True, check=True)
    problem, ordinary = done.stdout.splitlines()
    assert problem.startswith("real_time.lock_memory = true and real_time.priority = 50: not permitted on this machine")
    assert "/etc/security/limits.conf" in problem
    assert ordinary == "True"


def test_nothing_asked_for_changes_nothing() -> None:
    assert in_a_thread(RealTimeParameters()) == ("", os.sched_getaffinity(0))
