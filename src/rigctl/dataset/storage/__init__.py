"""Runs in object storage, or in any other place that `fsspec` has an address for: ``s3://bucket/runs``.

A run is written to a folder of this computer, where a bench can rely on the disk, and sent when it is closed
(`upload`). It is read where it lies (`Store`): of a table what is asked for, and no copy is kept.
"""

from rigctl.dataset.storage.sending import Uploaded, upload
from rigctl.dataset.storage.store import Store, StoredFolder

__all__ = ["Store", "StoredFolder", "Uploaded", "upload"]
