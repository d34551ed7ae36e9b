"""pycolmap, without its hold on signals: import it from here.

Its logging library takes SIGTERM when it is loaded, and prints a stack of native calls in answer.  What this
program wants to do about that signal is put back.
"""

import signal
import threading

import pycolmap as pycolmap

if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is not None:
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM))
