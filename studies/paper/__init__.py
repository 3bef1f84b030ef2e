"""The paper's figures on scenes of ours, and what of its findings holds there."""
