"""Worker processes, which must not outlive the process that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time

PATIENCE = 1.0
"""seconds that a worker has for cleaning up after its parent has ended"""


def end_with_parent() -> None:
    """Make this process, started by `multiprocessing`, end when its parent ends, whatever the cause and whatever this
    process is computing.

    Otherwise idle workers would wait for ever, since each holds both ends of the queue and so never sees it close, and
    busy workers would go on computing results that no process reads.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent,), name="rcdn-parent", daemon=True).start()


def _watch(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE)
    os._exit(1)
