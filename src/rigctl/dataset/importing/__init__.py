"""Data that was measured elsewhere, brought in as a run."""

from rigctl.dataset.importing.bring_in import Imported, import_file

__all__ = ["Imported", "import_file"]
