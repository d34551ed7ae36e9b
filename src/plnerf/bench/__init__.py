"""Measurements of plnerf itself: ops, training, rendering."""
