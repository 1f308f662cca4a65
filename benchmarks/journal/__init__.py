"""Recording: rows and events a second, and bytes a row, beside Python's own csv writer."""
