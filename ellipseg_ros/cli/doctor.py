"""`ellipseg doctor`: what is wrong with an installation or a running graph, and what to do."""

import json
import os
import subprocess
import sys
from argparse import Namespace
from dataclasses import asdict

from ellipseg_ros.cli.report import say
from ellipseg_ros.doctor import environment, graph, installation
from ellipseg_ros.doctor.findings import ERROR, Finding, failed
from ellipseg_ros.errors import EllipsegError

LOAD = "import sys; from ellipseg_ros.ros.import_check import main; sys.exit(main())"
PATIENCE = 60.0  # s
Findings = dict[str, list[Finding]]  # by section


def run(args: Namespace) -> int:
    """Look at everything and tell; 1 if anything is an error."""
    if not 0.0 < args.seconds <= 3600.0:
        raise EllipsegError(f"--seconds is {args.seconds:g}; it must be above 0, at most 3600")
    middleware, messages = _load()
    installed = installation.look(messages)
    surroundings = environment.look(os.environ, ".".join(map(str, installed.python)), middleware)
    findings: Findings = {
        "installation": list(installation.check(installed)),
        "environment": list(environment.check(surroundings)),
    }
    if not (args.offline or messages or not middleware):
        say(f"listening for {args.seconds:g} s ...", args)
        findings["graph"] = _graph(args, surroundings)
    show(findings, args)
    return 1 if any(map(failed, findings.values())) else 0


def _load() -> tuple[str, str]:
    """The middleware, and what is wrong with ROS or our messages."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", LOAD], capture_output=True, text=True, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        return "", f"ROS does not load within {PATIENCE:g} s"
    if done.returncode == 0:
        told = json.loads(done.stdout.splitlines()[-1])
        return told["middleware"], told["problem"]
    last = done.stderr.strip().splitlines()[-1:] or [f"the process ended with {done.returncode}"]
    return "", f"ROS does not load: {' '.join(last[0].split())}"


def _graph(args: Namespace, surroundings: environment.Environment) -> list[Finding]:
    from ellipseg_ros.ros.graph_probe import GraphProbe  # only here: it needs what _load has tried

    try:
        with GraphProbe(args.topic, args.namespace) as observer:
            seen = observer.observe(args.seconds)
    except EllipsegError as error:
        return [Finding(ERROR, str(error), "mend what is said above, or the names given")]
    return list(graph.check(seen, surroundings.receive_buffer))


def show(findings: Findings, args: Namespace) -> None:
    """Print all: as JSON, as lines, or, with --quiet, the errors alone."""
    if args.json:
        rows = [
            {"section": section, **asdict(finding)}
            for section, found in findings.items()
            for finding in found
        ]
        print(json.dumps(rows, indent=2))
        return
    for section, found in findings.items():
        if not args.quiet:
            print(f"{section[0].upper()}{section[1:]}")
        for finding in found:
            if finding.level == ERROR or not args.quiet:
                _print(finding)
    sys.stdout.flush()


def _print(finding: Finding) -> None:
    print(f"  {finding.level:<6} {finding.what}")
    if finding.do:
        print(f"         -> {finding.do}")
