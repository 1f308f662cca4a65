"""Common parts of benches on a port: the port, its guard, reconnection, and the backend."""
