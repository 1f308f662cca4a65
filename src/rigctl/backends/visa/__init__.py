"""A line-based instrument behind VISA, on network, USB, GPIB or a serial line."""
