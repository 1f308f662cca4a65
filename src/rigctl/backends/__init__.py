"""Backends with one interface: simulated, replayed and emulated benches, and real devices."""
