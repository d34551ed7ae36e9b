"""Write the poses of any scene as a COLMAP model beside its images, so that other tools can read it.

python examples/00_export_colmap.py SCENE OUT
"""

import sys
from pathlib import Path

from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import write_colmap


def main(scene: Path, out: Path) -> None:
    """OUT gets sparse/0 (binary) and a link to the scene's images."""
    listing = read_listing(scene)
    (out / "sparse" / "0").mkdir(parents=True)
    write_colmap(listing, out / "sparse" / "0")
    (out / "images").symlink_to((listing.root / "images").resolve(), target_is_directory=True)
    print(f"{len(listing.shots)} cameras: {out / 'sparse' / '0'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
