"""Studies: measurements of the package, run from a checkout with `python -m studies.NAME`."""

# Name: (what it measures, about how long that takes on two cores).
STUDIES = {
    "benchmark": ("speed, latency and memory, beside other libraries", "20 min"),
    "partition": ("segments and objects against true classes, beside other methods", "1 h"),
    "partition.scale": ("effect and stability of the object scale", "a minute per scene"),
    "landmarks": ("repeatability and association of landmarks over two drives", "1 h"),
    "paper": ("figures and findings of the paper on other scenes", "5 min"),
    "paper.readings": ("alternative readings of ambiguous passages of the paper", "10 min"),
    "endurance": ("an hour of driving, overload, odd input and fault injection", "75 min"),
}
