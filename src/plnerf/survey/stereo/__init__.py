"""Photos and wires in, points on surfaces out: dense matching of pairs of images."""
