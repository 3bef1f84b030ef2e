"""Thresholds by AICc: of one window, of many, on this machine, on a cluster, and live."""
