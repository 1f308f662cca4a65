"""A device with Modbus registers, on TCP or a serial line, described by its rig file."""
