"""Rays, frustums, contraction and step functions along a ray."""
