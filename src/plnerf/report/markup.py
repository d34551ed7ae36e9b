"""HTML by small functions: whatever is not Markup is escaped, so that no name can break a page."""

import base64
import html
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from plnerf.errors import SurveyError

JPEG_QUALITY = 84
PICTURE_PX = 1280
"""Greatest width of a picture in the page; larger ones are reduced by area."""


class Markup(str):
    """HTML that is complete and safe as it stands."""


def safe(text: str) -> Markup:
    """Text as HTML: Markup as it is, all else escaped."""
    return text if isinstance(text, Markup) else Markup(html.escape(text, quote=True))


def tag(name: str, *content: str, **attributes: str) -> Markup:
    """An element.  A trailing underscore of an attribute's name is dropped, others become hyphens."""
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(value, quote=True)}"'
        for key, value in attributes.items()
    )
    return Markup(f"<{name}{written}>{''.join(safe(part) for part in content)}</{name}>")


def joined(parts: Sequence[str]) -> Markup:
    """One after the other."""
    return Markup("\n".join(safe(part) for part in parts))


def section(id_: str, title: str, *content: str) -> Markup:
    """A part of the page with its heading."""
    return tag("section", tag("h2", title), joined(content), id=id_)


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], caption: str, left: set[int]) -> Markup:
    """A table that scrolls sideways where it is wider than the screen.

    left: columns of words, set left; all others are figures and set right.
    """

    def line(name: str, cells: Sequence[str]) -> Markup:
        return tag("tr", *(
            tag(name, cell, class_="words" if k in left else "figure") for k, cell in enumerate(cells)
        ))  # fmt: skip

    head = tag("thead", line("th", columns))
    body = tag("tbody", *(line("td", row) for row in rows))
    # Not the table's own caption, which would scroll away with it.
    told = tag("figcaption", caption)
    return tag("figure", told, tag("div", tag("table", head, body), class_="wide", tabindex="0"))


def bullets(texts: Sequence[str]) -> Markup:
    """A list of sentences."""
    return tag("ul", *(tag("li", text) for text in texts))


def facts(pairs: Sequence[tuple[str, str]]) -> Markup:
    """Names and what belongs to each."""
    return tag("dl", *(tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs))


def picture(rgb: UInt8[np.ndarray, "h w 3"], caption: str) -> Markup:
    """A picture inside of the page, as JPEG.  Raises SurveyError for one without pixels."""
    height, width = rgb.shape[:2]
    if not height or not width:
        raise SurveyError(f"The picture {caption!r} has {width} x {height} pixels. Give one that has some.")
    if width > PICTURE_PX:
        size = (PICTURE_PX, max(1, round(height * PICTURE_PX / width)))
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(
        ".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    source = f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}"
    image = Markup(
        f'<img src="{source}" width="{rgb.shape[1]}" height="{rgb.shape[0]}" alt="{safe(caption)}">'
    )
    return tag("figure", image, tag("figcaption", caption))
