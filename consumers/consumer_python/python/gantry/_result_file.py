"""Writing results into a file beside a recording."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Sequence

import numpy as np
import numpy.typing as npt

from . import _layout
from ._load import native
from ._publish import BytesSchema, Publisher, described

if TYPE_CHECKING:
    from ._recording import Recording


class ResultFile:
    """A file of results that answer a recording: a context manager.

    It is a recording of its own, of the same run: `gantry.Recording` reads it, and `gantry record merge
    drive.mcap boxes.mcap both.mcap` lays it beside the frames, for replays, viewers and exports. Until
    its end it is called `FILE.part`; after an exception in the block it stays so, and `gantry record
    recover` rescues what was written.

    Every result has the times of the frames that it answers, as if none had gone by: a file is read
    without a clock, and the same frames give the same results.
    """

    def __init__(self, source: Recording, path: str | os.PathLike[str]) -> None:
        #: Path of the file.
        self.path = os.fspath(path)
        known = source.metadata
        of_run: dict[str, dict[str, str]] = {name: known[name] for name in ("world/info", "run", "classes") if name in known}
        domain = known.get("gantry", {}).get("domain", "")
        about = {"domain": domain, "recorder": "the Python package gantry", "schema_version": str(_layout.SCHEMA_VERSION), "answers": source.path}
        epoch = of_run.get("world/info", {}).get("epoch", "")
        self._file = native.ResultFile(self.path, int(epoch) if epoch.isdigit() else 0, {"gantry": about, **of_run})

    def __enter__(self) -> ResultFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self._file.give_up()

    def __repr__(self) -> str:
        return f"<gantry.ResultFile {self.path}>"

    def close(self) -> None:
        """Finishes the file, and gives it its name. Raises `GantryError` if the disk refuses, or the name was taken meanwhile."""
        self._file.finish()

    def publish(
        self,
        topic: str,
        type: str,
        *,
        classes: Sequence[str] = (),
        fields: npt.DTypeLike | None = None,
        bones: Sequence[tuple[int, int]] = (),
        schema: BytesSchema | None = None,
        note: str = "",
    ) -> Publisher:
        """Begins a topic of the file; arguments, and what the publisher's `send` and `loan` do, are as those of `gantry.publish`.

        Raises `ValueError` for an unknown type or a description that does not fit, `GantryError` for a
        name that cannot be, or that this file has already.
        """
        about, point = described(classes, fields, bones, schema, note)
        return _FilePublisher(self, topic, type, about, point)


class _FilePublisher(Publisher):
    """A topic of a file."""

    def __init__(self, file: ResultFile, topic: str, type: str, about: dict[str, Any], point: np.dtype[Any]) -> None:
        self._file = file
        super().__init__(topic, type, "", about, {}, point)

    def _open(self, about: dict[str, Any], capacities: dict[str, int]) -> Any:
        self._file._file.describe(self.name, self.type, json.dumps(about))
        return _FilePort(self._file._file, self.name, self.type)

    def __repr__(self) -> str:
        return f"<gantry.Publisher {self._file.path}: {self.name} {self.type}>"


class _FilePort:
    """What `native.Publisher` is to shared memory."""

    def __init__(self, file: native.ResultFile, topic: str, type: str) -> None:
        self._file, self._topic, self._type = file, topic, type

    def loan(self, n_bytes: int) -> _FileLoan:
        return _FileLoan(self._file, self._topic, self._type, n_bytes)

    def n_readers(self) -> int:
        return 0

    def close(self) -> None:
        """The file ends its topics."""


class _FileLoan:
    """What `native.Loan` is to shared memory."""

    def __init__(self, file: native.ResultFile, topic: str, type: str, n_bytes: int) -> None:
        self._file, self._topic = file, topic
        self._bytes = np.zeros(n_bytes, np.uint8)
        self._draft = native.FileDraft(type)
        self.set_list, self.set_image, self.set_tensor = self._draft.set_list, self._draft.set_image, self._draft.set_tensor
        self.answers, self.describe, self.give_back = self._draft.answers, self._draft.describe, self._draft.give_back

    def array(self, dtype: np.dtype[Any], sizes: Sequence[int], strides: Sequence[int], offset: int) -> npt.NDArray[Any]:
        return np.ndarray(tuple(sizes), dtype, self._bytes, offset, tuple(strides))

    def write(self, offset: int, data: bytes) -> None:
        self._bytes[offset : offset + len(data)] = np.frombuffer(data, np.uint8)

    def send(self) -> int:
        self._file.write(self._topic, self._draft, self._bytes[: self._draft.body_bytes()].tobytes())
        return 0
