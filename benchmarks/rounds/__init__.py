"""Designed rounds on every shipped rig: how many of ten thousand trip an interlock."""
