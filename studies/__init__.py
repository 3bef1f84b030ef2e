"""Studies: benchmarks, evaluations and endurance tests, run from a checkout."""
