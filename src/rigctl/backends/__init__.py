"""Benches behind one protocol: simulated, replayed, and real ones on a serial line."""
