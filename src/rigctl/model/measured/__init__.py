"""Conversion of runs to inputs and measured outputs of a model."""

from rigctl.model.measured.conditions import condition_text
from rigctl.model.measured.read import read_measurements
from rigctl.model.measured.record import MeasuredRecord, Measurements

__all__ = ["MeasuredRecord", "Measurements", "condition_text", "read_measurements"]
