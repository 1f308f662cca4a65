"""A model's free parameters, fitted to measurements."""
