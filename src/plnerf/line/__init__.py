"""The line: frame, structures, spans and wires as values, and their files."""
