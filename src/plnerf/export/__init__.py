"""A survey in, files that other programs read out."""
