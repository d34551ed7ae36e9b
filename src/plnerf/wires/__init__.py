"""Conductors as curves: their evidence in images, finding them, scoring them against the truth."""
