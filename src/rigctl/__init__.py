"""rigctl: run physical test benches, compare a model with what was measured, learn what is missing."""
