"""Conversion of runs to inputs and measured outputs of a model."""

from rigctl.model.measured.read import read_measurements

__all__ = ["read_measurements"]
