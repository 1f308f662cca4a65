"""Whether a model agrees with its measurements, where not, and whether a sensor or a bound may be why."""
