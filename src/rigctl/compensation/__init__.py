"""Using a model: the set-point that keeps a quantity at its target while the operating point drifts."""
