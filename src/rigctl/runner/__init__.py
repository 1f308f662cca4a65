"""Carrying out a plan on a bench: states, steps, interlocks, cleanup, resume, lock."""
