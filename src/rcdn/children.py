"""Processes that were started to share work: they must not outlive the one that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time

PATIENCE = 1.0
"""seconds to clean up in after the parent has gone"""


def end_with_parent() -> None:
    """Have this process, which `multiprocessing` started, end if its parent is gone, whatever killed that, and whatever is being computed.

    Those that wait for work would see no end of it, since each of them holds both ends of the queue; those that compute would go on for nobody.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent,), name="rcdn-parent", daemon=True).start()


def _watch(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE)
    os._exit(1)
