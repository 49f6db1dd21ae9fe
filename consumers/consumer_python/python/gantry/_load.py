"""Loads the native module, and says what to do if it is missing or of another version."""

from __future__ import annotations

import atexit
import os
import sys

from . import _layout

__all__ = ["native"]

#: Number of the interface that this half of the package speaks.
INTERFACE = 13

_BUILD = "build it with ./gantry up in the repository, or pip install ./consumers/consumer_python"

try:
    from . import _native as native
except ImportError as cause:
    raise ImportError(f"gantry's native module cannot be loaded ({cause}); {_BUILD}") from cause

if (native.INTERFACE, native.SCHEMA_VERSION) != (INTERFACE, _layout.SCHEMA_VERSION):
    raise ImportError(
        f"gantry's native module has interface {native.INTERFACE} and schema {native.SCHEMA_VERSION}, "
        f"this package needs {INTERFACE} and {_layout.SCHEMA_VERSION}; {_BUILD}"
    )

native.set_program(os.path.basename(sys.argv[0]) if sys.argv and sys.argv[0] not in ("", "-c", "-m") else "python")
atexit.register(native.close_all)
