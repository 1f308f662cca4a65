"""Whether designed records tell what they promise: the tier ``design``, learning on the separate bench."""
