"""A worker that dies and hangs when it is told to; apart from the test, so that it starts soon."""

import os
import time


def dying(pipe):
    """Answer tasks but those that are deadly."""
    pipe.send("ready")
    task = pipe.recv()
    if task["kind"] == "dies":
        os._exit(7)
    if task["kind"] == "hangs":
        time.sleep(60.0)
    pipe.send({"code": 2, "line": "", "seconds": 0.0, "memory_mb": 0.0, "fault": ""})
