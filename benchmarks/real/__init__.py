"""Real logs of real benches: where each was published, and how the tables of the tier `real` are made."""
