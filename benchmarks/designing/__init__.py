"""What designing the next records takes."""
