"""Hide Linux features from Python processes with this folder in PYTHONPATH.

Windows lacks these modules and functions; Windows and macOS lack these libraries.
"""

import ctypes
import os
import signal
import sys
from types import ModuleType

import psutil  # noqa: F401 - on Linux, psutil needs some of them

for _module in ("fcntl", "resource", "termios"):
    sys.modules[_module] = None  # type: ignore[assignment]

for _call in ("setpgid", "killpg", "getpgid", "sched_getaffinity", "fork"):
    delattr(os, _call)
del signal.SIGHUP

# The replacement of fcntl on Windows; this one does not lock.
_msvcrt = ModuleType("msvcrt")
_msvcrt.LK_LOCK, _msvcrt.LK_NBLCK = 1, 2  # type: ignore[attr-defined]
_msvcrt.locking = lambda descriptor, mode, size: None  # type: ignore[attr-defined]
sys.modules["msvcrt"] = _msvcrt

_LIBRARIES = ("EGL", "GLU", "OSMesa", "libGL", "libvulkan")
_open = ctypes.CDLL.__init__


def _refuse(self, name, *arguments, **options):  # type: ignore[no-untyped-def]
    if name is not None and any(word in str(name) for word in _LIBRARIES):
        raise OSError(f"{name}: library not found on this system")
    _open(self, name, *arguments, **options)


ctypes.CDLL.__init__ = _refuse  # type: ignore[method-assign]
