"""What a rig file says of a device's protocol: lines, registers, nodes, and their checks."""
