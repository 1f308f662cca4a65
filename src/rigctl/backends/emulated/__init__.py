"""The board's firmware on an emulated ATmega328P, with its pins wired to the simulated bench."""
