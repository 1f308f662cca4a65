"""The tier of several devices: the same bench read by one device and by four, with the same answers."""
