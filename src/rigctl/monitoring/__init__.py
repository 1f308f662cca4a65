"""Condition monitoring: one model over many runs, what has changed, since when, and with what certainty."""
