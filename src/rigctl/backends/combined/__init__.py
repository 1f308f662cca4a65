"""One bench out of several devices, each read and commanded in a thread of its own."""
