"""A simulated bench: a plant, its sensors and its faults, on any clock."""
