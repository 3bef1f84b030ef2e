"""The command line `ellipseg`: the one place that prints and that catches errors."""
