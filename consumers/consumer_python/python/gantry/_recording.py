"""Reading recordings: the frames, results and snapshots of a file, as they came from shared memory."""

from __future__ import annotations

import itertools
import json
import os
from typing import Any, Callable, Iterator, NamedTuple, Sequence, TypeVar

from ._errors import GantryError
from ._frame import Frame
from ._load import native
from ._result import About, Result
from ._result_file import ResultFile
from ._sync import Row
from ._world import Document, Snapshot, parse_snapshot

T = TypeVar("T")
_END = 2**64 - 1
#: Ticks after which a tick of which something is missing is given up: free-running cameras are a few ticks late.
_TICKS_APART = 8
#: Looks for a tick at most, and the distance from which on its neighbours are read one by one.
_GUESSES, _NEAR_TICKS = 64, 4
#: Sentences about damage that are kept.
_MOST_SENTENCES = 16


class RecordedTopic(NamedTuple):
    """A topic of a recording."""

    #: Name without the domain: `ego/front/rgb`.
    name: str
    #: `frame`, `result`, `snapshot`, `document`, `journal` or `foreign` (messages of other programs).
    kind: str
    #: Name of the messages' schema.
    schema: str
    #: Encoding of the messages.
    encoding: str
    #: Number of messages; None if the file does not tell it.
    n_messages: int | None


class Message(NamedTuple):
    """A message of another program."""

    #: Topic as in the file, without a leading slash.
    topic: str
    #: Time under which it is filed, seconds.
    time: float
    #: Name of its schema: `foxglove.RawImage`.
    schema: str
    #: Encoding of `data`: `protobuf`, `cdr`, `json`, …
    encoding: str
    #: The message.
    data: bytes


#: What a recording holds.
Sample = Frame | Result | Snapshot | Document | Message


class Recording:
    """A recording that is open for reading.

    A file of any length is open at once, and one that was cut off is read as far as it goes. Nothing
    is kept: each sample is read when its turn comes. Times are simulated seconds since the simulator
    started; `start` and `end` of a method limit it to start ≤ time < end. Patterns of topics may
    have `*` for any characters and `?` for one; without any, all are read.

    Its length is the number of its ticks. `close`, and the end of a `with` block, end what is read.

    >>> import gantry
    >>> with gantry.Recording("drive.mcap") as drive:                  # doctest: +SKIP
    ...     for frame in drive.frames("ego/front/rgb", start=10.0):
    ...         print(frame.tick, frame.array.shape)
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Opens a file. Raises `GantryError` if it is not there, is no MCAP file, or is of a newer version."""
        #: Path of the file.
        self.path = os.fspath(path)
        self._file = native.Recording(self.path)
        #: Topics by kind and name, without the pictures that are there for other programs.
        self.topics: list[RecordedTopic] = [RecordedTopic(*facts) for facts in self._file.topics()]
        self._closed = False
        self._cursors: list[native.Cursor] = []
        self._damage: dict[str, int] = {}
        self._sentences: list[str] = []

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def writer(self, path: str | os.PathLike[str]) -> ResultFile:
        """Begins a file of results beside this one:

            with gantry.Recording("drive.mcap") as drive, drive.writer("boxes.mcap") as out:
                boxes = out.publish("mine/boxes", "boxes2d", classes=["person"])
                for frame in drive.frames("ego/front/rgb"):
                    boxes.send(detect(frame.rgb), answers=frame)

        Raises `GantryError` if a file of this name, or its part file, is there, or cannot be made.
        """
        return ResultFile(self, path)

    def close(self) -> None:
        """Ends whatever still reads; frames and results that are held stay as they are."""
        self._closed = True

    def __len__(self) -> int:
        counted = {topic.name: topic.n_messages for topic in self.topics if topic.kind == "snapshot"}
        if not counted:
            # Without a world the topic with the most frames tells.
            return max((topic.n_messages or 0 for topic in self.topics if topic.kind in ("frame", "result")), default=0)
        known = next(iter(counted.values()))
        return sum(1 for _ in self.snapshots()) if known is None else known

    def __bool__(self) -> bool:
        return True

    def __repr__(self) -> str:
        return f"<gantry.Recording {self.path} {self.start:.2f} to {self.end:.2f} s>"

    @property
    def start(self) -> float:
        """Time of the first message, seconds; 0 without any."""
        span = self._file.span()
        return span[0] * 1e-9 if span else 0.0

    @property
    def end(self) -> float:
        """Time of the last message, seconds; 0 without any."""
        span = self._file.span()
        return span[1] * 1e-9 if span else 0.0

    @property
    def is_complete(self) -> bool:
        """Whether the file was finished: one that is still written, or was cut off, was not."""
        return self._file.is_complete

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records by name: `gantry`, `run`, `losses`, …"""
        found = {name: self._file.metadata(name) for name in self._file.metadata_names()}
        return {name: pairs for name, pairs in found.items() if pairs is not None}

    @property
    def attachments(self) -> list[str]:
        """Names of the attached files, the map among them: `Town10HD.xodr`."""
        return self._file.attachment_names()

    def attachment(self, name: str) -> bytes:
        """Returns an attached file. Raises `KeyError` if there is none of this name."""
        data = self._file.attachment(name)
        if data is None:
            raise KeyError(f"{self.path} has no attachment {name!r}; it has {', '.join(self.attachments) or 'none'}")
        return data

    def document(self, name: str, time: float | None = None) -> Document:
        """Returns the text of a document that is in force at a time; by default at the end.

        `drive.document("world/info").json()["map"]`. Raises `KeyError` if there is none.
        """
        for topic, revision, tick, _, text in self._file.documents_at(_END if time is None else _nanos(time)):
            if topic == name:
                return Document(revision, tick, text)
        raise KeyError(f"{self.path} has no document {name!r}{'' if time is None else f' at {time} s'}")

    def frames(self, *topics: str, start: float = 0.0, end: float | None = None) -> Iterator[Frame]:
        """Reads frames in the order of the file. Their arrays are read-only and stay as long as they are held.

        Raises `GantryError` at the end if there were some and none could be read: colour that was recorded with
        `--jpeg` or `--video` has pictures for people and no frames.
        """
        return self._read(("frame",), topics, start, end, self._frame, must_find="frame")

    def results(self, *topics: str, start: float = 0.0, end: float | None = None) -> Iterator[Result]:
        """Reads results of users' programs in the order of the file."""
        abouts = self._abouts(start)

        def make(item: tuple[Any, ...]) -> Result | None:
            return _result(item, abouts)

        return self._read(("result", "document"), topics, start, end, make)

    def frame(self, topic: str, tick: int) -> Frame:
        """Returns the frame of a tick, found in a few steps in a file of any length.

        Raises `KeyError` if the topic has none of this tick, `GantryError` for a topic that is not there.
        """
        return self._frame(self._of_tick("frame", topic, tick))

    def result(self, topic: str, tick: int) -> Result:
        """Returns the result that is about a tick, as `frame`."""
        item = self._of_tick("result", topic, tick)
        found = _result(item, self._abouts(item[2] * 1e-9))
        assert found is not None, "a result is no document"
        return found

    def _of_tick(self, kind: str, topic: str, tick: int) -> tuple[Any, ...]:
        self._known([topic], (kind,))
        missing = KeyError(f"{self.path} has no {kind} of {topic} of tick {tick}")
        head = list(itertools.islice(self._items(kind, topic, 0), 2))
        if not head or tick < head[0][3].tick:
            raise missing
        low, second = head[0], head[-1]
        # Ticks follow one another in steps of about the same length: guess, look, and guess again from there.
        nanos_per_tick = max((second[2] - low[2]) / max(second[3].tick - low[3].tick, 1), 1.0)
        end = (self._file.span() or (0, 0))[1] + 1
        for _ in range(_GUESSES):
            if tick - low[3].tick <= _NEAR_TICKS:
                break
            guess = min(int(low[2] + (tick - low[3].tick - 0.5) * nanos_per_tick), low[2] + (end - low[2]) * 9 // 10)
            found = next(self._items(kind, topic, guess), None)
            if found is None or found[3].tick > tick:
                end = guess
                nanos_per_tick /= 2
            elif found[3].tick == low[3].tick:
                break
            else:
                nanos_per_tick = (found[2] - low[2]) / (found[3].tick - low[3].tick)
                low = found
        for item in self._items(kind, topic, low[2]):
            if item[3].tick == tick:
                return item
            if item[3].tick > tick + _TICKS_APART:
                break
        raise missing

    def _items(self, kind: str, topic: str, nanos: int) -> Iterator[tuple[Any, ...]]:
        self._check_open()
        cursor = self._file.read(nanos, _END, [kind], [topic])
        while (item := cursor.next()) is not None:
            yield item

    def _frame(self, item: tuple[Any, ...]) -> Frame:
        frame: Frame = item[3]
        if frame.is_image:
            file, nanos = self._file, item[2]
            frame._look = lambda: _info(file, nanos)
        return frame

    def _check_open(self) -> None:
        if self._closed:
            raise GantryError(f"{self.path} is closed")

    def _known(self, topics: Sequence[str], kinds: Sequence[str]) -> None:
        """Raises `GantryError` for topics that are not in the file."""
        there = [topic.name for topic in self.topics if topic.kind in kinds]
        unknown = [name for name in topics if name not in there]
        if unknown:
            raise GantryError(f"{self.path} has no {' or '.join(f'{kind}s' for kind in kinds)} of {', '.join(unknown)}; it has {', '.join(there) or 'none'}")

    def snapshots(self, start: float = 0.0, end: float | None = None) -> Iterator[Snapshot]:
        """Reads the world tick by tick."""
        return self._read(("snapshot",), (), start, end, lambda item: parse_snapshot(item[3], item[4]))

    def messages(self, *topics: str, start: float = 0.0, end: float | None = None) -> Iterator[Message]:
        """Reads the messages of other programs' files, undecoded."""
        return self._read(("foreign",), topics, start, end, _message)

    def journal(self) -> Iterator[dict[str, Any]]:
        """Reads what acted on the world, in its order: commands, controls and what else a run is made again from."""
        return self._read(("journal",), (), 0.0, None, lambda item: dict(json.loads(item[3])))

    def samples(self, *topics: str, start: float = 0.0, end: float | None = None) -> Iterator[Sample]:
        """Reads everything in the order of the file; snapshots and documents whatever the topics."""
        abouts = self._abouts(start)

        def make(item: tuple[Any, ...]) -> Sample | None:
            kind = item[0]
            if kind == "frame":
                return self._frame(item)
            if kind == "snapshot":
                return parse_snapshot(item[3], item[4])
            if kind == "foreign":
                return _message(item)
            result = _result(item, abouts)
            return Document(item[4][0], item[4][1], item[3]) if kind == "document" else result

        return self._read(("frame", "result", "snapshot", "document", "foreign"), topics, start, end, make)

    def sync(self, topics: Sequence[str], start: float = 0.0, end: float | None = None, *, snapshots: bool = False) -> Iterator[Row]:
        """Reads frames and results tick by tick, of the ticks of which every topic has one, as `gantry.sync` does live.

        Topics are names without patterns; `row["ego/front/rgb"]` is a frame, `row.result("mine/boxes")`
        a result. With `snapshots` each row has the world of its tick.
        """
        if not topics:
            raise ValueError("sync needs at least one topic")
        self._known(topics, ("frame", "result"))
        has_results = any(topic.kind == "result" and topic.name in topics for topic in self.topics)
        kinds = ("frame", *(("result", "document") if has_results else ()), *(("snapshot",) if snapshots else ()))
        return self._rows(kinds, tuple(topics), start, end, snapshots)

    def _rows(self, kinds: tuple[str, ...], topics: tuple[str, ...], start: float, end: float | None, snapshots: bool) -> Iterator[Row]:
        # A file holds one start of the simulator, so the tick alone says what belongs together.
        ticks: dict[int, dict[str, Any]] = {}
        worlds: dict[int, Snapshot] = {}
        abouts = self._abouts(start)

        def make(item: tuple[Any, ...]) -> Row | None:
            if item[0] == "snapshot":
                world = parse_snapshot(item[3], item[4])
                worlds[world.tick] = world
                _forget(worlds, world.tick)
                return None
            sample = self._frame(item) if item[0] == "frame" else _result(item, abouts)
            if sample is None:
                return None
            ticks.setdefault(sample.tick, {})[item[1]] = sample
            _forget(ticks, sample.tick)
            if len(ticks[sample.tick]) < len(set(topics)):
                return None
            found = ticks.pop(sample.tick)
            return Row({name: found[name] for name in topics}, worlds.get(sample.tick) if snapshots else None)

        return self._read(kinds, topics, start, end, make, must_find="frame" if kinds[1:2] != ("result",) else None)

    @property
    def damage(self) -> dict[str, int]:
        """What could not be read so far, by kind; empty if everything could."""
        sums = dict(self._damage)
        for cursor in self._cursors:
            _add(sums, cursor.damage()[0])
        return sums

    @property
    def damage_sentences(self) -> list[str]:
        """What could not be read so far, in words; of much damage only the first."""
        return self._sentences + [sentence for cursor in self._cursors for sentence in cursor.damage()[1]]

    def _abouts(self, start: float) -> dict[str, About]:
        documents = self._file.documents_at(_nanos(start))
        return {topic: About(json.loads(text)) for topic, _, _, _, text in documents if topic.endswith("/about")}

    def _read(
        self,
        kinds: tuple[str, ...],
        topics: tuple[str, ...],
        start: float,
        end: float | None,
        make: Callable[[tuple[Any, ...]], T | None],
        must_find: str | None = None,
    ) -> Iterator[T]:
        if end is not None and end < start:
            raise ValueError(f"end is {end} s, but must not be before start, {start} s")
        self._check_open()
        cursor = self._file.read(_nanos(start), _END if end is None else _nanos(end), list(kinds), list(topics))

        def items() -> Iterator[T]:
            self._cursors.append(cursor)
            is_found = False
            try:
                while not self._closed and (item := cursor.next()) is not None:
                    is_found = is_found or item[0] == must_find
                    made = make(item)
                    del item
                    if made is not None:
                        yield made
                    del made
            finally:
                self._cursors.remove(cursor)
                counts, sentences = cursor.damage()
                _add(self._damage, counts)
                self._sentences += sentences[: _MOST_SENTENCES - len(self._sentences)]
            if must_find is not None and not is_found and "codec" in counts:
                raise GantryError(f"{self.path}: none of {counts['codec']} frames can be read; {sentences[0]}")

        return items()


def _add(sums: dict[str, int], counts: dict[str, int]) -> None:
    for kind, n in counts.items():
        sums[kind] = sums.get(kind, 0) + n


def _nanos(seconds: float) -> int:
    if not 0.0 <= seconds < 1.8e10:
        raise ValueError(f"the time is {seconds} s, but must be 0 or more; times count from the simulator's start")
    return round(seconds * 1e9)


def _info(file: native.Recording, nanos: int) -> str | None:
    """Returns the text of `world/info` that is in force at a time."""
    return next((text for topic, _, _, _, text in file.documents_at(nanos) if topic == "world/info"), None)


def _result(item: tuple[Any, ...], abouts: dict[str, About]) -> Result | None:
    kind, topic = item[0], item[1]
    if kind == "document":
        if topic.endswith("/about"):
            abouts[topic] = About(json.loads(item[3]))
        return None
    return Result(item[3], topic, abouts.get(f"{topic}/about", About({})))


def _message(item: tuple[Any, ...]) -> Message:
    return Message(item[1], item[2] * 1e-9, item[4][0], item[4][1], item[3])


def _forget(kept: dict[int, Any], tick: int) -> None:
    """Drops what belongs to ticks long ago."""
    for old in [old for old in kept if old + _TICKS_APART < tick]:
        del kept[old]
