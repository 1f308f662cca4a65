"""Start-up time of commands."""
