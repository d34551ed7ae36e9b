"""A survey in, a page that people read out."""
