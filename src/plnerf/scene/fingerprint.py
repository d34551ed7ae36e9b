"""Fingerprints of files by their content: neither a name nor a time says whether a photo was replaced."""

import hashlib
from dataclasses import replace
from pathlib import Path

from plnerf.scene.listing import Listing


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal digits.  Raises OSError where it cannot be read."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def photos_sha256(listing: Listing) -> str:
    """One SHA-256 of the names and bytes of all photos and masks of a scene."""
    whole = hashlib.sha256()
    for shot in listing.shots:
        for path in (shot.path, shot.mask):
            whole.update(f"{shot.name} {file_sha256(path) if path else ''}\n".encode())
    return whole.hexdigest()


def listing_sha256(listing: Listing) -> str:
    """One SHA-256 of what a scene shows: photos, masks, poses, lenses, frame, held-out images.

    Neither the folder's place nor the files' times count.
    """
    shots = [
        (one.name, one.T_world_camera.tolist(), replace(one.intrinsics, owner="")) for one in listing.shots
    ]
    whole = (
        photos_sha256(listing), shots, listing.train, listing.test, listing.unit, listing.crs,
        *(None if part is None else part.tolist() for part in (listing.up, listing.origin)),
    )  # fmt: skip
    return hashlib.sha256(repr(whole).encode()).hexdigest()
