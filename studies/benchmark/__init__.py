"""Benchmark: cost of batches and updates, beside other libraries, measured in one run."""
