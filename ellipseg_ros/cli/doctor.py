"""`ellipseg doctor`: findings about an installation, its speed and a running graph."""

import json
import os
import subprocess
import sys
from argparse import Namespace
from dataclasses import asdict
from itertools import chain

from ellipseg_ros.cli.report import compile_kernels, print_status
from ellipseg_ros.doctor.clouds import check_speed
from ellipseg_ros.doctor.environment import check_environment, receive_buffer
from ellipseg_ros.doctor.findings import ERROR, Finding, error
from ellipseg_ros.doctor.graph import check_graph
from ellipseg_ros.doctor.installation import check_installation, is_interpreted, numba_error
from ellipseg_ros.doctor.snapshot import GraphSnapshot
from ellipseg_ros.errors import EllipsegError

IMPORT_ROS = "import sys; from ellipseg_ros.ros.import_check import main; sys.exit(main())"
IMPORT_TIMEOUT_S = 60.0
MAX_SECONDS = 3600.0  # of observation
Findings = dict[str, list[Finding]]  # by section


def run(args: Namespace) -> int:
    """Check everything and report; returns 1 if any finding is an error."""
    if not 0.0 < args.seconds <= MAX_SECONDS:
        limits = f"above 0, at most {MAX_SECONDS:g}"
        raise EllipsegError(f"--seconds is {args.seconds:g}; it must be {limits}")
    middleware, ros_error = _import_ros()
    findings: Findings = {
        "installation": list(check_installation(ros_error)),
        "environment": list(check_environment(os.environ, middleware)),
    }
    graph: GraphSnapshot | None = None
    if args.source:
        findings["recording"] = _recording(args)
    elif not (args.offline or ros_error or not middleware):
        print_status(f"observing the graph for {args.seconds:g} s ...", args)
        try:
            from ellipseg_ros.ros.graph_probe import GraphProbe  # only here: it needs ROS

            with GraphProbe(args.topic, args.namespace) as probe:
                graph = probe.probe(args.seconds)
            findings["graph"] = list(check_graph(graph, receive_buffer()))
        except EllipsegError as problem:
            remedy = "correct the errors above, or the names given"
            findings["graph"] = [error(str(problem), remedy)]
    if not (args.no_speed or is_interpreted() or numba_error()):
        findings["speed"] = [_speed(graph, args)]
    show(findings, args)
    return int(any(finding.level == ERROR for finding in chain(*findings.values())))


def _import_ros() -> tuple[str, str]:
    """The middleware, and why ROS or the messages do not load; each empty if there is none.

    In a process of its own: a missing RMW implementation ends the process that loads it.
    """
    try:
        program = [sys.executable, "-c", IMPORT_ROS]
        done = subprocess.run(program, capture_output=True, text=True, timeout=IMPORT_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return "", f"ROS does not load within {IMPORT_TIMEOUT_S:g} s"
    if done.returncode == 0:
        result = json.loads(done.stdout.splitlines()[-1])
        return result["middleware"], result["problem"]
    last = done.stderr.strip().splitlines()[-1:] or [f"the process ended with {done.returncode}"]
    return "", f"ROS does not load: {' '.join(last[0].split())}"


def _recording(args: Namespace) -> list[Finding]:
    """Findings about the recording that the command line names."""
    from ellipseg_ros.cli.sources import open_input  # only here: numba may not load
    from ellipseg_ros.doctor.recording import check_recording

    print_status(f"reading {args.source} ...", args)
    try:
        return list(check_recording(open_input(args.source, args)))
    except EllipsegError as problem:
        return [
            error(str(problem), "correct what it names; docs/guide/sensors.md describes inputs")
        ]


def _speed(graph: GraphSnapshot | None, args: Namespace) -> Finding:
    """Measure how many points per second this machine segments: some 10 s of computing."""
    from ellipseg_ros.doctor.speed import measure_speed  # only here: numba may not load

    compile_kernels(args)
    print_status("measuring the speed ...", args)
    return check_speed(measure_speed(), graph)


def show(findings: Findings, args: Namespace) -> None:
    """Print all findings as JSON or as lines; with --quiet, the errors alone."""
    if args.json:
        rows = [{"section": s} | asdict(finding) for s in findings for finding in findings[s]]
        print(json.dumps(rows, indent=2))
        return
    for section, results in findings.items():
        if not args.quiet:
            print(section.capitalize())
        for finding in results:
            if finding.level == ERROR or not args.quiet:
                print(f"  {finding.level:<6} {finding.text}")
                if finding.remedy:
                    print(f"         -> {finding.remedy}")
