"""Recording: rows and events per second, and bytes per row, compared with Python's csv writer."""
