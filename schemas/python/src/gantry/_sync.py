"""Frames of several topics that show the same tick."""

from __future__ import annotations

from typing import Iterator, Optional, Sequence

from ._frame import Frame
from ._topic import Topic, open as open_topic


class Row(dict):
    """Frames of one tick, by topic: `row["ego/front/rgb"]`."""

    def __init__(self, frames: dict[str, Frame]) -> None:
        super().__init__(frames)
        first = next(iter(frames.values()))
        #: Tick that all frames show.
        self.tick: int = first.tick
        #: Simulated time, seconds.
        self.sim_time: float = first.sim_time


class Sync:
    """Iterates over the ticks of which every topic has a frame; the slowest sensor sets the pace."""

    def __init__(self, topics: Sequence[str], domain: str, timeout: float) -> None:
        if not topics:
            raise ValueError("sync needs at least one topic")
        self._topics: dict[str, Topic] = {}
        try:
            for topic in topics:
                self._topics[topic] = open_topic(topic, domain, timeout)
        except Exception:
            self.close()
            raise

    def __enter__(self) -> "Sync":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes all topics."""
        for topic in self._topics.values():
            topic.close()
        self._topics = {}

    def next(self, timeout: Optional[float] = None) -> Optional[Row]:
        """Returns the frames of the next complete tick.

        Returns None if the frame of some topic did not arrive within `timeout` seconds (None:
        without a limit). Raises as `Topic.poll`.
        """
        heads: dict[str, Frame] = {}
        target: Optional[tuple[int, int]] = None
        while len(heads) < len(self._topics):
            for name, topic in self._topics.items():
                while name not in heads:
                    frame = topic.next(timeout)
                    if frame is None:
                        return None
                    place = (frame.header.epoch, frame.tick)
                    # A frame of another epoch: the simulator restarted and counts its ticks from 1
                    # again, so the frames collected so far are dropped.
                    if target is None or place[0] != target[0] or place[1] >= target[1]:
                        heads[name], target = frame, place
                    frame = None
            heads = {name: frame for name, frame in heads.items() if (frame.header.epoch, frame.tick) == target}
        return Row({name: heads[name] for name in self._topics})

    def __iter__(self) -> Iterator[Row]:
        while self._topics:
            row = self.next()
            if row is not None:
                yield row
            row = None


def sync(topics: Sequence[str], domain: str = "gantry", timeout: float = 0.0) -> Sync:
    """Opens several topics, to be read tick by tick.

    Waits up to `timeout` seconds for each to appear. Raises as `open`.
    """
    return Sync(topics, domain, timeout)
