"""Condition monitoring: one model over many runs, what has changed, since when, and how sure that is."""
