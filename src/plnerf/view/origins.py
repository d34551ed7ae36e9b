"""Whether a browser asks for the viewer's own page, or for that of somebody else.

Any web page may open a websocket to a port of the machine that its reader sits at; browsers say from which
page.  A page of the viewer comes from the address that it asks, and that is one of this machine: a name that
somebody else has made point here is none.
"""

import ipaddress
import socket
from collections.abc import Mapping
from urllib.parse import urlsplit


def own_page(headers: Mapping[str, str], host: str) -> bool:
    """Whether a request with these headers is to be answered by a server that listens at `host`.

    What says no origin is no browser, and sits at this machine or was let in by --host.
    """
    asked = headers.get("Host", "")
    origin = headers.get("Origin")
    if origin is not None and urlsplit(origin).netloc.lower() != asked.lower():
        return False
    name = (urlsplit(f"//{asked}").hostname or "").lower()
    return name in {"localhost", host.lower(), socket.gethostname().lower()} or _is_address(name)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
