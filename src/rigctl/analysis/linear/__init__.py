"""A model linearised at its fit: signatures of candidates beside all unknowns, tests and likelihoods."""
