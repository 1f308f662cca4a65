"""Import of data measured elsewhere, as a run."""

from rigctl.dataset.importing.bring_in import Imported, import_file, import_files
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.read_table import read_table

__all__ = ["Imported", "Options", "import_file", "import_files", "read_table"]
