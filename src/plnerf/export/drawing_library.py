"""ezdxf, also for users without a home, as containers have them: import it from here.

It asks for the home folder when it is loaded, where its settings might lie, and fails where a user has
neither HOME nor an entry in the system's list of users.  While it is loaded, the root folder stands for it
then, as in containers.  Where it cannot keep its list of fonts, it says so, which no drawing of lines needs.
"""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def _quietly_with_a_home() -> Iterator[None]:
    homeless, logger = False, logging.getLogger("ezdxf")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        Path.home()
    except RuntimeError:
        homeless = True
        os.environ["HOME"] = os.sep
    try:
        yield
    finally:
        logger.setLevel(level)
        if homeless:
            del os.environ["HOME"]


with _quietly_with_a_home():
    from ezdxf import units as units
    from ezdxf.entities.polyline import Polyline as Polyline
    from ezdxf.filemanagement import new as new
    from ezdxf.filemanagement import readfile as readfile
