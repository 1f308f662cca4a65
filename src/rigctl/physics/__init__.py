"""Equations of the oil and of the benches, each with its source; no solver, no data of a run."""
