"""Equations to numbers: symbols, compiled kernels, integration with sensitivities, least squares."""
