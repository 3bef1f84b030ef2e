"""A worker process that crashes or hangs on request; few imports, so that it starts fast."""

import os
import time


def crashing_worker(pipe):
    """Answer a task, unless its kind is to die or to hang."""
    pipe.send("ready")
    task = pipe.recv()
    if task["kind"] == "dies":
        os._exit(7)
    if task["kind"] == "hangs":
        time.sleep(60.0)
    pipe.send({"code": 2, "line": "", "seconds": 0.0, "memory_mb": 0.0, "fault": ""})
