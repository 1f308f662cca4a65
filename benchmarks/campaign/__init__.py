"""The published campaign, from command to page."""
