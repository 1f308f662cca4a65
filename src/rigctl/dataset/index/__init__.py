"""An index of a runs folder, in SQLite: one row for each run, and the range of each of its channels.

The folders are authoritative. The index is derived from them, is stored in the user's cache, and may be
deleted at any time: `rigctl.dataset.index.file` decides when it is used, rebuilt or bypassed.
"""
