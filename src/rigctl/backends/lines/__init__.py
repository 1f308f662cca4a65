"""A device that is spoken to in lines, as its rig file describes it."""
