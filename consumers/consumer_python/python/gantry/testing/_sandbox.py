"""What one test has for itself: a folder, a domain, and a part of shared memory."""

from __future__ import annotations

import itertools
import json
import os
import pathlib
import shutil
import tempfile

from .. import _control, _domain, _world
from .._load import native

_SHARED_MEMORY = pathlib.Path("/dev/shm")
_numbers = itertools.count()


class Sandbox:
    """Folder and names of one simulator. Processes that are started in it meet nobody else."""

    def __init__(self) -> None:
        number = next(_numbers)
        #: Working folder of every process.
        self.folder: pathlib.Path = pathlib.Path(tempfile.mkdtemp(prefix="gantry-"))
        #: Domain of the simulator.
        self.domain: str = f"t{os.getpid()}x{number}"
        #: Start of the names of its files in `/dev/shm`.
        self.prefix: str = f"gt{os.getpid()}y{number}_"
        self._links = itertools.count()
        root = self.folder / "iox"
        root.mkdir()
        (self.folder / "config").mkdir()
        # iceoryx2 reads this file in the working folder of every process.
        self._config = self.folder / "config" / "iceoryx2.toml"
        self._config.write_text(f"[global]\nroot-path = {json.dumps(str(root))}\nprefix = {json.dumps(self.prefix)}\n")
        # Programs accept a runtime folder only if nobody else may enter it.
        (self.folder / "run").mkdir(mode=0o700)
        # This process works elsewhere, so it is told.
        native.set_private(self.domain, root, self.prefix)
        _domain.sandboxes.append(self.domain)

    def environment(self) -> dict[str, str]:
        """Folders of a user who has never used Gantry, so that a test does not depend on the maps and recordings of this one."""
        # Compiled shaders stay where they are: compiling them takes seconds.
        caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
        return {
            "XDG_DATA_HOME": str(self.folder / "data"),
            "XDG_CACHE_HOME": str(self.folder / "cache"),
            "XDG_RUNTIME_DIR": str(self.folder / "run"),
            "MESA_SHADER_CACHE_DIR": os.environ.get("MESA_SHADER_CACHE_DIR") or caches,
        }

    def links_to(self, folder: str | os.PathLike[str]) -> pathlib.Path:
        """Makes a folder of links to everything in `folder`.

        A program that is started there finds its files, and is in this sandbox. What it writes
        there is gone with the sandbox, unless it changes a file that a link leads to.
        """
        source = pathlib.Path(folder).resolve()
        place = self.folder / f"links{next(self._links)}"
        config = place / "config"
        config.mkdir(parents=True)
        shutil.copy(self._config, config / self._config.name)
        for origin, into in ((source, place), (source / "config", config)):
            for entry in origin.iterdir() if origin.is_dir() else ():
                link = into / entry.name
                if not link.exists():
                    link.symlink_to(entry)
        return place

    def leave(self) -> tuple[list[str], bool]:
        """Removes all there is, and returns what processes left in shared memory.

        The second value says whether this process holds nothing of it any more.
        """
        _world.forget(self.domain)
        _control.forget(self.domain)
        if self.domain in _domain.sandboxes:
            _domain.sandboxes.remove(self.domain)
        free = native.leave(self.domain)
        files = list(_SHARED_MEMORY.glob(self.prefix + "*"))
        # iceoryx2 keeps its one management file of 16 bytes on purpose.
        left = sorted(path.name for path in files if not path.name.endswith(".global_mgmt"))
        for path in files:
            path.unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)
        return left, free
