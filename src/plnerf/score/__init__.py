"""A survey and the ground truth in, how far off it is out."""
