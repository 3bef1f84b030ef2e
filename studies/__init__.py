"""Studies: measurements of the package, run from a checkout with `python -m studies.NAME`."""

# Name: (what it measures, about how long it takes on two cores).
STUDIES = {
    "benchmark": ("speed, latency and memory, beside other libraries", "10 to 20 min"),
    "partition": ("segments and objects against labelled scans, beside other methods", "1 h"),
    "partition.scale": ("effect and stability of the object scale", "5 min"),
    "landmarks": ("repeatability and association of landmarks over two drives", "1 h"),
    "paper": ("the paper's figures and findings on simulated and own scenes", "10 min"),
    "paper.readings": ("alternative interpretations of the paper's equations", "30 min"),
    "endurance": ("an hour of driving, overload, odd input and fault injection", "75 min"),
}
