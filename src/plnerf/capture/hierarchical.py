"""Models of many images: COLMAP maps overlapping blocks of them and joins the blocks, then all are adjusted.

Mapping image by image adjusts all images again and again, so that its time grows faster than their number;
blocks of one size each take the time and memory of one.  COLMAP divides the images by how many matches they
share, and joins blocks by the images that both have (Schoenberger and Frahm 2016; its hierarchical mapper).
Each block has a lens of its own until the last bundle adjustment, which fits one to all.
"""

from pathlib import Path
from typing import Any

from plnerf.scene.colmap import pycolmap

OVERLAP = 0.1
"""Share of a block's images that the next one has as well: COLMAP's own, 50 of 500."""
LEAST_OVERLAP = 5


def map_in_blocks(
    database: Path, images: Path, folder: Path, incremental: Any, block: int, threads: int
) -> None:
    """Maps blocks of at most so many images, side by side, and writes the joined models into a folder.

    incremental: pycolmap.IncrementalPipelineOptions, of each block.
    """
    options = pycolmap.HierarchicalPipelineOptions(
        num_threads=threads, num_workers=threads, incremental_options=incremental
    )
    options.clustering_options.leaf_max_num_images = block
    options.clustering_options.image_overlap = max(LEAST_OVERLAP, round(OVERLAP * block))
    models = pycolmap.hierarchical_mapping(database, images, folder, options)
    adjustment = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=incremental.ba_refine_focal_length,
        refine_extra_params=incremental.ba_refine_extra_params,
        print_summary=False,
    )
    for number, model in models.items():
        pycolmap.bundle_adjustment(model, adjustment)
        model.write(folder / str(number))
