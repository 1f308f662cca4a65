"""The commands, one module each; some have further modules, named after the command."""
