"""Forecasts before anything moves: how long a plan takes, what it records, and how near it comes to
limits."""

from rigctl.plan.forecast import Basis
from rigctl.planning.preview import Preview, preview

__all__ = ["Basis", "Preview", "preview"]
