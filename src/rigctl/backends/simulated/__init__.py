"""A bench that is computed: a plant, its sensors, its faults, on any clock."""
