"""Tuning of the threshold by AICc: one window, many, on processes or a cluster, and live."""
