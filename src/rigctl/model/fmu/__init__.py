"""A model as a Functional Mock-up Unit (FMI 2.0, co-simulation) for other simulators."""

from rigctl.model.fmu.export import export_fmu

__all__ = ["export_fmu"]
