"""Pictures of windows and of tuning curves."""
