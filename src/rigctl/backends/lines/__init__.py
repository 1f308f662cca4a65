"""A device with a line-based text protocol, described by its rig file."""
