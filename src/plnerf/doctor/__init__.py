"""Photos or a scene in, what is wrong with them out, before any work."""
