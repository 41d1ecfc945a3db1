"""Who comes first on a busy machine: the flight, before all that only looks or keeps."""

import contextlib
import os
import sys


def give_way(niceness: int) -> None:
    """Let the flight come before this thread and those that it starts from now on.

    `niceness` (0..19) is added. On Linux, where it is each thread's own, they are batch work too:
    one that wakes waits for a core and takes none from a thread of the flight that runs. Who is in
    a lower class already stays there. Elsewhere the whole process becomes nicer.
    """
    os.nice(niceness)
    if sys.platform == "linux" and os.sched_getscheduler(0) == os.SCHED_OTHER:
        with contextlib.suppress(PermissionError):  # a sandbox: niceness is all that there is
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
