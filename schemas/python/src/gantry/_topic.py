"""Reading a frame topic: every frame in order, or the newest one."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Iterator, Optional

import iceoryx2 as iox2

from . import _bus
from ._errors import GantryError
from ._frame import Frame

#: Longest single wait, so that Ctrl-C takes effect soon.
_SLICE_SECS = 0.1


@dataclass
class Counts:
    """What a reader has received and missed."""

    #: Frames that were returned.
    taken: int = 0
    #: Frames that `latest` passed over.
    skipped: int = 0
    #: Frames that never arrived: gaps in `seq`.
    lost: int = 0
    #: Number of times that the simulator restarted.
    restarts: int = 0


class Topic:
    """An open frame topic: a context manager, and an iterator over every frame in order."""

    def __init__(self, topic: str, domain: str) -> None:
        self._full = _bus.full_name(topic, domain)
        #: Name without the domain.
        self.name: str = self._full[len(domain) + 1:]
        self._service: Any = _bus.open_slices(topic, domain, "FrameHeader")
        self._port: Any = _bus.subscribe(self._service, self._full)
        self._limit: int = self._service.static_config.subscriber_max_borrowed_samples
        self._listener: Any = _bus.event(f"{self.name.split('/')[0]}/tick", domain).listener_builder().create()
        self._place: Optional[tuple[int, int]] = None
        #: Counters since the topic was opened.
        self.counts = Counts()

    def __enter__(self) -> "Topic":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<gantry.Topic {self._full} {'open' if self._port is not None else 'closed'}>"

    def close(self) -> None:
        """Closes the topic. Frames that are still held stay valid until they are dropped."""
        for port in (self._port, self._listener):
            if port is not None:
                port.delete()
        self._port = self._listener = self._service = None

    def poll(self) -> Optional[Frame]:
        """Takes the oldest frame that waits, or returns None if none does.

        Raises `BorrowLimitError` if too many frames are held, `FrameFormatError` or
        `SchemaVersionError` for a frame that breaks the contract.
        """
        if self._port is None:
            raise GantryError(f"topic {self._full!r} is closed")
        sample = _bus.receive(self._port, self._full, self._limit)
        if sample is None:
            return None
        frame = Frame.of_sample(sample, _bus.frame_header_memory(sample), sample.header.number_of_elements, self.name)
        self._count(frame)
        return frame

    def next(self, timeout: Optional[float] = None, busy_wait: float = 0.0) -> Optional[Frame]:
        """Takes the next frame; waits up to `timeout` seconds for it (None: without a limit).

        Returns None if no frame arrived in time. For the first `busy_wait` seconds the reader polls
        instead of sleeping: it has the frame some 100 µs earlier, because it need not be woken, but
        keeps a processor and Python's global lock busy. Raises as `poll`.
        """
        frame = self._wait(timeout, busy_wait)
        self.counts.taken += frame is not None
        return frame

    def latest(self, timeout: Optional[float] = None, busy_wait: float = 0.0) -> Optional[Frame]:
        """Takes the newest frame, and waits as `next` does if there is none.

        Older frames are dropped and counted in `counts.skipped`. Raises as `poll`.
        """
        newest = self._wait(timeout, busy_wait)
        while newest is not None and self._port.has_samples():
            self.counts.skipped += 1
            newest = None  # The older frame is given back before the next one is taken.
            newest = self.poll()
        self.counts.taken += newest is not None
        return newest

    def __iter__(self) -> Iterator[Frame]:
        while self._port is not None:
            frame = self.next()
            if frame is not None:
                yield frame
            frame = None

    def _wait(self, timeout: Optional[float], busy_wait: float = 0.0) -> Optional[Frame]:
        frame = self.poll()
        if frame is not None:
            return frame
        began = time.monotonic()
        deadline = None if timeout is None else began + timeout
        if busy_wait > 0.0:
            end, has_samples = began + (busy_wait if timeout is None else min(busy_wait, timeout)), self._port.has_samples
            while not has_samples() and time.monotonic() < end:
                pass
        while True:
            frame = self.poll()
            if frame is not None:
                return frame
            left = _SLICE_SECS if deadline is None else min(deadline - time.monotonic(), _SLICE_SECS)
            if left <= 0:
                return None
            self._listener.timed_wait(iox2.Duration.from_micros(max(1, int(left * 1e6))))

    def _count(self, frame: Frame) -> None:
        epoch, seq = frame.header.epoch, frame.header.seq
        if self._place is not None:
            if self._place[0] != epoch:
                self.counts.restarts += 1
            else:
                self.counts.lost += max(0, seq - self._place[1] - 1)
        self._place = (epoch, seq)


def open(topic: str, domain: str = "gantry", timeout: float = 0.0) -> Topic:  # noqa: A001 - read as gantry.open
    """Opens a frame topic such as `ego/front/rgb`; waits up to `timeout` seconds for it to appear.

    Raises `NoSuchTopicError` if it does not, `TooManyReadersError` if it has no place left, and
    `SchemaVersionError` if the simulator has another version.
    """
    from ._errors import NoSuchTopicError

    deadline = time.monotonic() + timeout
    while True:
        try:
            return Topic(topic, domain)
        except NoSuchTopicError:
            if time.monotonic() >= deadline:
                raise
            time.sleep(_SLICE_SECS)
