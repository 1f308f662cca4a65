"""The command line: a thin layer; each command parses, calls the library, and shows the result."""
