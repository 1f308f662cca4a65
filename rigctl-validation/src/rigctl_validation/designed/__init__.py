"""Whether designed records have their predicted power: the tier ``design``, learning on the separate
bench."""
