"""The command line: thin; each command parses, calls the library, and shows what came back."""
