"""What a classified cloud tells of a line: wires, spans, supports."""
