"""Pairs of images as COLMAP reads them: a line for each pair, two names with a space between.

So no name in such a list may hold a space, or begin with the mark of a comment; photos are called
"IMG (1).jpg" all the same.  While a list is read, these images have other names in the database.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from plnerf.scene.colmap import pycolmap
from plnerf.scene.files import write_text


def stand_ins(names: Sequence[str]) -> dict[str, str]:
    """Other names for those that a list of pairs cannot hold; the same ones for the same images."""
    return {
        name: f"plnerf-image-{place}"
        for place, name in enumerate(sorted(names))
        if len(name.split()) != 1 or name.startswith("#")
    }


@contextmanager
def listed_pairs(
    database: Path, listing: Path, names: Sequence[str], pairs: Sequence[tuple[str, str]]
) -> Iterator[None]:
    """A list of pairs on disk whose names are, inside the block, those of the database's images."""
    other = stand_ins(names)
    write_text(listing, "".join(f"{other.get(a, a)} {other.get(b, b)}\n" for a, b in pairs))
    rename_images(database, other)
    try:
        yield
    finally:
        rename_images(database, {new: old for old, new in other.items()})


def rename_images(database: Path, other: Mapping[str, str]) -> None:
    """Gives the images of a database other names, where there are any for them."""
    if not other:
        return
    with pycolmap.Database.open(database) as db:
        for image in db.read_all_images():
            if image.name in other:
                image.name = other[image.name]
                db.update_image(image)
