"""Simpler shapes on photographs: what the regulariser, `simplify` and free baselines do to a network's masks."""
