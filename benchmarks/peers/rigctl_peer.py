"""rigctl, measured like its peers: steps through the runner, rows into the journal and on to Parquet."""

from __future__ import annotations
