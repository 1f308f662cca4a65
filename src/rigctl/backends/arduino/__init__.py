"""A bench behind a serial line: rigctl's own board, and how it is spoken to."""
