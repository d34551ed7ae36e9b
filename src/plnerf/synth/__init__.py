"""A span of known geometry, rendered with its exact truth."""
