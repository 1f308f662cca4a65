"""Designed rounds on every shipped rig: does one of ten thousand trip an interlock?"""
