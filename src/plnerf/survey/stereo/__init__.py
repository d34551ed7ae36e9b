"""Surfaces from pairs of images."""
