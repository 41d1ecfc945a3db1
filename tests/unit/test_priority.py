"""What gives way to the flight: this thread's own niceness and class, nobody else's."""

import os
import sys
import threading

import pytest

from juncnet.priority import give_way


@pytest.mark.skipif(sys.platform != "linux", reason="a thread's own niceness is Linux's")
@pytest.mark.parametrize("idle", [False, True])
def test_a_thread_gives_way_alone_and_keeps_a_lower_class(idle: bool) -> None:
    before = (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0))
    found: list[tuple[int, int]] = []

    def work() -> None:
        if idle:
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        give_way(3)
        found.append((os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    was_idle = idle or before[0] == os.SCHED_IDLE
    kept = os.SCHED_IDLE if was_idle else os.SCHED_BATCH
    assert found == [(kept, min(19, before[1] + 3))]
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before
