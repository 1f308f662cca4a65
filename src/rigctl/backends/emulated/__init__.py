"""The board's own firmware on an emulated ATmega328P, its pins wired to the simulated bench."""
