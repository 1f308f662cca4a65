"""A server of OPC UA, whose nodes the rig file names."""
