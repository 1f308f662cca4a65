"""How well a model agrees with measurements, and where it fails."""
