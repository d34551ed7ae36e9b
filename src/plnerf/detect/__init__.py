"""Images in, wires out."""
