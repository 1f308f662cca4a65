"""What sequencers and data-acquisition tools people use today cost, measured the same way as ours."""
