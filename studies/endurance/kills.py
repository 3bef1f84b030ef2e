"""Subject `kills`: SIGKILL of node, replayer, subscriber and bag writer."""

import os
import random
import signal
import time
from dataclasses import dataclass, field
from itertools import pairwise

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from studies.endurance.bag_writer_kills import killed_writers
from studies.endurance.programs import node, started
from studies.endurance.requirements import Options, Requirement, first_of
from studies.endurance.rig import UPDATE_PERIOD, Rig, is_unbroken, rig
from studies.endurance.subscriber_process import SubscriberProcess

MARKER_LIFETIME_S = 10


def kills(options: Options) -> list[Requirement]:
    """Kill every program that communicates with the node, and the node itself."""
    return [
        *killed_nodes(options),
        *killed_replayers(options),
        *killed_subscribers(options),
        *killed_writers(options),
    ]


# --- the node --------------------------------------------------------------------------------


@dataclass
class Restarts:
    """Results of nodes that were started after another one was killed."""

    seconds: list[float] = field(default_factory=list)  # from the start to the first update
    out_of_sync: list[str] = field(default_factory=list)  # first messages of a node
    stale_markers: list[str] = field(default_factory=list)

    def judge(self, test_rig: Rig, started_at: float) -> None:
        """Check the first messages of a new node."""
        first = test_rig.updates_of_new_node(started_at)[0]
        if not (first.full and first.in_sync):
            self.out_of_sync.append(f"the first message was {first}")
        if test_rig.stale_markers_of_new_node(started_at)[0]:
            self.stale_markers.append("a marker of a dead node remained beside the new ones")


def killed_nodes(options: Options) -> list[Requirement]:
    """Kill the node and start another, repeatedly."""
    rng = random.Random(options.seed)
    count = 1 if options.quick else 10
    restarts = Restarts()
    with rig(options.seed) as test_rig:
        for number in range(count + 1):
            options.log(f"kills: the node, {number} of {count}")
            started_at = time.monotonic()
            with test_rig.node() as process:
                # Every other node is killed while it starts, but not the first and the last.
                if number % 2 == 0 or number == count:
                    restarts.seconds.append(test_rig.wait_for_new_node(started_at))
                    if number:
                        restarts.judge(test_rig, started_at)
                    time.sleep(rng.uniform(0.0, 3.0 * UPDATE_PERIOD))
                else:
                    time.sleep(rng.uniform(0.0, restarts.seconds[0]))
                os.kill(process.pid, signal.SIGKILL)
        lifetimes = test_rig.subscriber.lifetimes_s
    return restart_requirements(restarts, lifetimes, count)


def restart_requirements(
    restarts: Restarts, lifetimes_s: set[int], kills: int
) -> list[Requirement]:
    """Requirements on subscribers of killed and restarted nodes; lifetimes_s: of all markers."""
    seconds = sorted(restarts.seconds)
    judged = len(seconds) - 1  # the first node follows no dead one
    return [
        Requirement(
            "after SIGKILL of the node, subscribers are in sync with the first message of a new "
            "one",
            f"SIGKILL at {kills + 1} random moments, half of them during the start; restarted",
            f"first message full and mirror in sync in {judged - len(restarts.out_of_sync)} of "
            f"{judged} runs; {seconds[len(seconds) // 2]:.1f} s from the start to the first "
            f"update (median; at most {seconds[-1]:.1f} s){first_of(restarts.out_of_sync)}",
            judged > 0 and not restarts.out_of_sync,
        ),
        Requirement(
            "markers of a dead node disappear",
            f"the same; all markers have a lifetime of {MARKER_LIFETIME_S} s, and a new node "
            "deletes all markers first",
            f"lifetimes {sorted(lifetimes_s)} s; no marker of a dead node beside those of a new "
            f"one in {judged - len(restarts.stale_markers)} of {judged} runs"
            f"{first_of(restarts.stale_markers)}",
            lifetimes_s == {MARKER_LIFETIME_S} and judged > 0 and not restarts.stale_markers,
        ),
    ]


# --- replayer and subscriber -----------------------------------------------------------------


def killed_replayers(options: Options) -> list[Requirement]:
    """Kill the publisher of clouds and start it again, so that the stamps jump back."""
    count = 1 if options.quick else 8
    rng = random.Random(options.seed)
    seconds: list[float] = []
    out_of_sync = 0
    with rig(options.seed, replays=False) as test_rig, test_rig.node() as process:
        source = ["-p", "source:=sim:industrial", "-p", "clock:=false"]
        for number in range(count + 1):
            options.log(f"kills: the replayer, {number} of {count}")
            started_at = time.monotonic()
            with started(node("replayer", *test_rig.ros_args, *source), test_rig.folder):
                seconds.append(test_rig.wait_for_updates(started_at, 4))
                time.sleep(rng.uniform(0.0, 2.0 * UPDATE_PERIOD))
            _, *others = test_rig.subscriber.since(started_at)
            out_of_sync += sum(not update.in_sync for update in others)
        process.stop()
    sequence = test_rig.sequence()
    restarts = sum(b.stamp_ns < a.stamp_ns for a, b in pairwise(test_rig.subscriber.updates))
    unbroken = is_unbroken(sequence)
    return [
        Requirement(
            "the node survives a killed publisher of clouds, and restarts its window with the "
            "next",
            f"SIGKILL of the replayer at {count + 1} random moments; restarted, same recording",
            f"{len(sequence)} updates with{'out' if unbroken else ''} a gap in their numbers, "
            f"{restarts} restarts of the window, mirror out of sync after {out_of_sync} messages; "
            f"at most {max(seconds):.1f} s from the restart to the fourth update",
            unbroken and restarts == count and not out_of_sync,
        )
    ]


def killed_subscribers(options: Options) -> list[Requirement]:
    """Kill one of two subscribers."""
    count = 1 if options.quick else 10
    longest = 0.0
    with rig(options.seed) as test_rig, test_rig.node() as process:
        test_rig.wait_for_updates(time.monotonic(), 3)
        for number in range(count):
            options.log(f"kills: a subscriber, {number + 1} of {count}")
            with SubscriberProcess(test_rig.ros_args) as subscriber:
                subscriber.wait_for_topics(START_TIMEOUT_S)
                connected_at = time.monotonic()
                test_rig.wait_for_updates(connected_at, 2)
                subscriber.kill()
                test_rig.wait_for_updates(time.monotonic(), 4)
            times = [update.time for update in test_rig.subscriber.since(connected_at)]
            longest = max(longest, *(late - early for early, late in pairwise(times)))
        process.stop()
    sequence = test_rig.sequence()
    unbroken = is_unbroken(sequence)
    return [
        Requirement(
            "a killed subscriber does not affect the node",
            f"SIGKILL of {count} subscribers to all topics, an update every {UPDATE_PERIOD:g} s",
            f"{'no' if unbroken else 'an'} update missing of {len(sequence)}, at most "
            f"{longest:.2f} s between two",
            unbroken,
            longest < 4.0 * UPDATE_PERIOD,
        )
    ]
