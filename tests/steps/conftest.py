"""Steps written in the test, on the shipped rig."""

from procedure.conftest import only, planned, rig, steps

__all__ = ["only", "planned", "rig", "steps"]
