"""A bench on a serial line: rigctl's own board and its protocol."""
