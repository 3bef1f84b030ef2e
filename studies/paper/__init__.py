"""The paper's figures on simulated scenes and recordings, and which of its findings hold there."""
