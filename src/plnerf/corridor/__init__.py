"""Whole corridors: an input that is larger than memory in, block after block; one line and one report out."""
