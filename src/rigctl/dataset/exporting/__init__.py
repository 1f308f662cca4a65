"""Export of a run's data to files that other programs read."""

from rigctl.dataset.exporting.export import default_table, export_junit, export_run
from rigctl.dataset.exporting.ro_crate import export_ro_crate

__all__ = ["default_table", "export_junit", "export_ro_crate", "export_run"]
