"""Readers of file formats: each gives a table of numbers as written, with its headings."""
