"""Two surveys of a line in; what differs between them, beyond what is not known of either, out."""
