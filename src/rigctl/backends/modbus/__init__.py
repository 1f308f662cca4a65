"""A device with Modbus registers, on TCP or a serial line, as its rig file describes them."""
