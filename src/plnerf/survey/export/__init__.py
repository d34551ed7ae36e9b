"""A survey as files: CSV, GeoJSON, GeoPackage, DXF, LAS, PLY."""
