"""What every bench at the end of a port shares: the port, its guard, finding it again, and being a bench."""
