"""Using a model: the set-point that keeps a quantity where it is wanted while the operating point drifts."""
