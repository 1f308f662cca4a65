"""Draft family, rig and model files from a user's data or from a template, to be edited.

`read` reads the columns of a file, `roles` says which are inputs and which outputs, `templates` writes the
equations with first values from the data, and `write` makes the files' text.
"""
