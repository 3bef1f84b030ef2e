"""SIGKILL of `ellipseg segment` while it writes a bag, which must remain readable."""

import random
import tempfile
import time
from pathlib import Path

from ellipseg_ros.cli.results import prepare
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.bag import read_messages
from ellipseg_ros.io.topics import UPDATE_TOPICS
from studies.endurance.programs import command, started, stderr_text
from studies.endurance.requirements import Options, Requirement, first_of

SEGMENT = (
    *("segment", "sim:industrial", "--duration", "40"),
    *("-q", "--no-pictures", "-o", "out"),
)
FIRST_UPDATE_TIMEOUT_S = 90.0  # kernels may have to be compiled first
PRINT_WRITTEN = """import ellipseg_ros.io.bag as bag
write = bag.BagSink.write_update
bag.BagSink.write_update = lambda sink, update: (
    write(sink, update), sys.stderr.write(f'{update.sequence}\\n'), sys.stderr.flush()
)"""  # prints the number of every update that is in the bag


def killed_writers(options: Options) -> list[Requirement]:
    """Kill `ellipseg segment` at random moments after its first update."""
    rng = random.Random(options.seed)
    count = 1 if options.quick else 15
    updates: list[int] = []
    problems: list[str] = []
    for number in range(count):
        options.log(f"kills: `ellipseg segment`, {number + 1} of {count}")
        with tempfile.TemporaryDirectory() as folder:
            try:
                updates.append(_kill_writer(Path(folder), rng.uniform(0.0, 2.0)))
            except EllipsegError as error:
                problems.append(str(error))
    readable = len(updates)
    found = f", {min(updates)} to {max(updates)} updates in them" if updates else ""
    return [
        Requirement(
            "a bag is readable up to the last update when `ellipseg segment` is killed",
            f"SIGKILL at {count} random moments; the bag read with rosbags, and its folder reused "
            "by the next run",
            f"{readable} of {count} readable{found}{first_of(problems)}",
            not problems,
        )
    ]


def _kill_writer(folder: Path, after_s: float) -> int:
    """Kill it some time after its first update; returns the number of updates in its bag.

    Raises EllipsegError if the bag is not as it must be.
    """
    with started(command(*SEGMENT, before=PRINT_WRITTEN), folder) as process:
        deadline = time.monotonic() + FIRST_UPDATE_TIMEOUT_S
        while not stderr_text(folder) and process.poll() is None:
            if time.monotonic() > deadline:
                raise EllipsegError(f"no update within {FIRST_UPDATE_TIMEOUT_S:g} s")
            time.sleep(0.01)
        time.sleep(after_s)
        code = process.poll()
        process.kill()
        process.wait()
    if code is not None and code != 0:
        raise EllipsegError(f"it ended by itself with {code}: {stderr_text(folder)[-200:]}")
    return _updates_in_bag(folder / "out", len(stderr_text(folder).splitlines()))


def _updates_in_bag(results: Path, written: int) -> int:
    """Number of updates in the bag, of which at least `written` must be there."""
    bag = results / "bag"
    numbers = [message.sequence for _, message in read_messages(bag, "/segments")]
    topics = [f"/{topic.name}" for topic in UPDATE_TOPICS]
    counts = {topic: sum(1 for _ in read_messages(bag, topic)) for topic in topics}
    prepare(results, "sim:industrial")  # as the next run does
    if numbers != list(range(len(numbers))) or set(counts.values()) != {len(numbers)}:
        raise EllipsegError(f"the bag has updates {numbers}, messages {counts}")
    if len(numbers) < written:
        raise EllipsegError(f"{written} updates were written, the bag has {len(numbers)}")
    return len(numbers)
