"""The cost of other sequencers and data-acquisition tools, measured in the same way as rigctl."""
