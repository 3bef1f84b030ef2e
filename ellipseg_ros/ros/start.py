"""Entry points of the executables: a signal ends them cleanly from the first line on.

The nodes themselves are imported afterwards, which takes seconds.
"""

from importlib import import_module

from ellipseg_ros.node.shutdown import ShutdownHandler


def segmenter() -> int:
    """`ros2 run ellipseg_ros segmenter`."""
    return _run("segmenter_node")


def associator() -> int:
    """`ros2 run ellipseg_ros associator`."""
    return _run("associator_node")


def replayer() -> int:
    """`ros2 run ellipseg_ros replayer`."""
    return _run("replayer")


def _run(module: str) -> int:
    shutdown = ShutdownHandler(exit_code=0)
    code = int(import_module(f"ellipseg_ros.ros.{module}").main())
    return shutdown.finish(code)
