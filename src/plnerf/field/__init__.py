"""The radiance field: encodings, hash grid, PL-NeRF's two networks, pose corrections."""
