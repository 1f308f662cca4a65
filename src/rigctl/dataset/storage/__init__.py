"""Runs in object storage, or at any other address supported by `fsspec`: ``s3://bucket/runs``.

A run is written to a local folder, since a bench must rely on the disk, and is uploaded after it is closed
(`upload`). It is read in place (`Store`): only the requested parts of a table, without a local copy.
"""

from rigctl.dataset.storage.sending import upload
from rigctl.dataset.storage.store import Store, StoredFolder

__all__ = ["Store", "StoredFolder", "upload"]
