"""What a line engineer wants of a trained field: points of wires, and what is measured on them."""
