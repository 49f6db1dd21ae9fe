"""A frame topic: iterate over every frame, or take the newest."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Iterator, Optional

import iceoryx2 as iox2

from . import _bus
from ._errors import GantryError
from ._frame import Frame

#: Longest single wait, so that Ctrl-C is heard.
_SLICE_SECS = 0.1


@dataclass
class Counts:
    """What a reader has seen."""

    #: Frames handed out.
    taken: int = 0
    #: Frames that `latest` passed over.
    skipped: int = 0
    #: Frames that never came: gaps in `seq`.
    lost: int = 0
    #: Times the simulator was restarted.
    restarts: int = 0


class Topic:
    """An open frame topic. Use it as a context manager; iterate over it for every frame in order."""

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
        """Gives the reader's place back. Frames in hand stay valid until dropped."""
        for port in (self._port, self._listener):
            if port is not None:
                port.delete()
        self._port = self._listener = self._service = None

    def poll(self) -> Optional[Frame]:
        """The oldest frame that waits, or None."""
        if self._port is None:
            raise GantryError(f"topic {self._full!r} is closed")
        sample = _bus.receive(self._port, self._full, self._limit)
        if sample is None:
            return None
        frame = Frame.of_sample(sample, _bus.frame_header_memory(sample), sample.header.number_of_elements, self.name)
        self._count(frame)
        return frame

    def next(self, timeout: Optional[float] = None, busy_wait: float = 0.0) -> Optional[Frame]:
        """The next frame, waiting up to `timeout` seconds (None: for ever). None if it did not come in time.

        For `busy_wait` seconds of these the reader looks again and again instead of sleeping: it has the frame some 100 µs earlier, because
        nobody has to wake it, and keeps a processor and Python's lock busy meanwhile.
        """
        frame = self._wait(timeout, busy_wait)
        self.counts.taken += frame is not None
        return frame

    def latest(self, timeout: Optional[float] = None, busy_wait: float = 0.0) -> Optional[Frame]:
        """The newest frame, waiting as `next` if none is there. Older ones are skipped and counted."""
        newest = self._wait(timeout, busy_wait)
        while newest is not None and self._port.has_samples():
            self.counts.skipped += 1
            newest = None  # given back before the next is taken
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
    """Opens a frame topic such as `ego/front/rgb`, waiting up to `timeout` seconds for it to appear."""
    from ._errors import NoSuchTopicError

    deadline = time.monotonic() + timeout
    while True:
        try:
            return Topic(topic, domain)
        except NoSuchTopicError:
            if time.monotonic() >= deadline:
                raise
            time.sleep(_SLICE_SECS)
