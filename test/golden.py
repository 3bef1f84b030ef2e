"""Digests of the results of scenes and scans.

Rewrite golden.json after an intended change: python test/golden.py [FOLDER WITH SCANS]
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.simulation import simulator
from studies.endurance.digests import CRITERIA, DURATION, digest, last_update
from studies.endurance.digests import SCENES as SIMULATED

FILE = Path(__file__).with_name("golden.json")
REAL = {  # every so manieth point, up to a time in s
    "kitti_2011_09_26_drive_0001": (8, 4.0),
    "lpm_car_rotating_sick": (2, np.inf),
    "oakland_part3_an": (2, np.inf),
    "semantickitti_frame": (2, np.inf),
    "treeiso_lpine1_tls": (16, np.inf),
}


def simulated(name: str) -> list[Sweep]:
    """The sweeps of a simulated scene."""
    return list(simulator.Scene(name, duration=DURATION))


def real(folder: Path, name: str) -> list[Sweep]:
    """The sweeps of a real one, thinned."""
    every, until = REAL[name]
    with np.load(folder / f"{name}.npz") as scene:
        points, times, number = (scene[key][::every] for key in ("xyz", "t", "sweep"))
    kept = times <= until
    ends = np.flatnonzero(np.diff(number[kept])) + 1
    parts = zip(np.split(points[kept], ends), np.split(times[kept], ends), strict=True)
    return [Sweep(round(float(t.max()) * SECOND), p.astype(np.float64)) for p, t in parts]


def facts(found) -> dict[str, float]:
    """The numbers that another machine must come near to."""
    counts = found.counts
    return {
        "points": len(found.points),
        "segmented": counts.segmented,
        "segments": len(found.ellipsoids),
        "objects": 0 if found.objects is None else len(found.objects),
        "aicc_per_point": round(found.aicc / counts.segmented, 6),
    }


def all_of_them(folder: Path) -> Iterator[tuple[str, str, list[Sweep]]]:
    """Yield (scene, criterion, sweeps)."""
    for name in SIMULATED:
        sweeps = simulated(name)
        for criterion in CRITERIA if name == "industrial" else CRITERIA[:1]:
            yield name, criterion, sweeps
    for name in REAL:
        yield name, CRITERIA[0], real(folder, name)


if __name__ == "__main__":
    there = Path(sys.argv[1] if sys.argv[1:] else FILE.parents[2] / "shared" / "data")
    golden = {}
    for scene, rule, drive in all_of_them(there):
        window = last_update(drive, rule)
        golden[f"{scene}, {rule}"] = facts(window)
        print(f"{scene}, {rule}: {digest(window)}")
    FILE.write_text(json.dumps(golden, indent=2) + "\n", encoding="utf-8")
