"""Finds lines in a point cloud: structures, spans, wires, and a class per point."""
