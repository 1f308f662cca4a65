"""Numerical kernels that numba compiles once per installation, whatever the model.

A kernel calls the model's functions by address (`calling`), so only those few are compiled for a new
model. Nothing here is imported before a model is compiled.
"""
