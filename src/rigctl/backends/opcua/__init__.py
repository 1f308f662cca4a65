"""An OPC UA server, whose nodes are named in the rig file."""
