"""A Modbus device on TCP or a serial line, whose registers are described by the rig file."""
