"""Ctrl-C and SIGTERM end a command alike, and neither is lost.

Python raises what a signal's handler raises wherever the main thread is.  In a destructor, after a fork or
in a callback of native code nothing can be raised: Python prints a traceback there, and goes on as if no
signal had come.  A command whose output nobody reads any more, as behind `| head`, ends as quietly as
others do.
"""

import _thread
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

AGAIN_S = 0.02
"""After a signal that Python could not raise, it comes once more."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a command as Ctrl-C does: what is half-written is removed."""


@contextmanager
def stoppable() -> Iterator[None]:
    """While the block runs, SIGTERM raises `Terminated`, and a signal that is not raised comes again."""
    before, hook = signal.signal(signal.SIGTERM, _terminate), sys.unraisablehook
    sys.unraisablehook = _again_before(hook)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)


def unread(error: OSError) -> bool:
    """Whether an error is that nobody reads standard output any more; nothing more is written there then."""
    if not isinstance(error, BrokenPipeError):
        return False
    try:
        print(flush=True)
    except BrokenPipeError:
        with open(os.devnull, "w") as nowhere:  # Python flushes once more at its end
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        return True
    return False


def _terminate(*_: object) -> None:
    raise Terminated


def _send(number: signal.Signals) -> None:
    """Sends the main thread a signal that it handles; where the system can, also while it sleeps or waits."""
    if not callable(signal.getsignal(number)):
        return
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)
    else:  # Windows
        _thread.interrupt_main(number)


def _again_before(hook: Callable[[Any], object]) -> Callable[[Any], object]:
    def heard(unraisable: Any) -> None:
        stop = unraisable.exc_value
        if not isinstance(stop, KeyboardInterrupt):
            hook(unraisable)
            return
        number = signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT
        # By another thread: here, too, nothing can be raised.
        once_more = threading.Timer(AGAIN_S, _send, (number,))
        once_more.daemon = True
        once_more.start()

    return heard
