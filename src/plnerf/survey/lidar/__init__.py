"""A point cloud in, its wires, structures and classes out."""
