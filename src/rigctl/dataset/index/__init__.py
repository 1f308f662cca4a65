"""An index of a runs folder, in SQLite: one row for each run, and what each of its channels ranges over.

The folders are the truth. The index is made from them, lies in the user's cache, and may be deleted at any
time: `rigctl.dataset.index.file` says when it is looked up, made again or done without.
"""
