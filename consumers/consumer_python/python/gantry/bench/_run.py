"""The loop of a program: newest frames, every frame, or tick by tick in lockstep."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any, Iterator, Mapping

import numpy as np

from .. import _records
from .._dtypes import RECORDS, TAILS
from .._errors import GantryError
from .._lockstep import Lockstep, lockstep as lockstep_as
from .._publish import Publisher, publish
from .._recording import Recording
from .._sync import Sync
from .._topic import Topic, open as open_topic
from ._program import Output, Program, outputs_of

#: Frames or results of one tick, by topic.
Samples = Mapping[str, Any]


@dataclass
class RunCounts:
    """What a program did."""

    #: Ticks whose frames it worked on.
    worked: int = 0
    #: Of them those that it answered.
    answered: int = 0
    #: Frames that were passed over because a newer one was there.
    skipped: int = 0
    #: Frames that it was too slow to get at all.
    lost: int = 0
    #: Seconds within `work`, of the wall clock.
    work_secs: float = 0.0


def params(argv: list[str] | None = None) -> dict[str, Any]:
    """Returns the settings in the last argument, which are `params` in a launch file or a suite.

    Without such an argument they are empty. Raises `GantryError` if it begins as a JSON object and
    is none.
    """
    words = sys.argv[1:] if argv is None else argv
    if not words or not words[-1].lstrip().startswith("{"):
        return {}
    try:
        return dict(json.loads(words[-1]))
    except ValueError as cause:
        raise GantryError(f"the settings in the last argument cannot be read: {cause}; they are a JSON object") from cause


class _Inputs:
    """The open inputs, joined by tick."""

    def __init__(self, topics: list[str], domain: str | None, timeout: float, newest: bool) -> None:
        self._newest = newest
        self._topic: Topic[Any] | None = open_topic(topics[0], domain, timeout) if len(topics) == 1 else None
        self._sync: Sync | None = None if self._topic is not None else Sync(topics, domain, timeout, False)
        self._passed_over = 0

    def next(self, timeout: float | None) -> Samples | None:
        """Returns what is to be worked on next, at the latest after `timeout` seconds."""
        if self._topic is not None:
            take = self._topic.latest if self._newest else self._topic.next
            sample = take(timeout, or_none=True)
            return None if sample is None else {self._topic.name: sample}
        assert self._sync is not None
        row = self._sync.next(timeout, or_none=True)
        while self._newest and row is not None and (newer := self._sync.next(0.0, or_none=True)) is not None:
            row = newer
            self._passed_over += 1
            del newer
        return row

    def count(self, counts: RunCounts) -> None:
        topics: list[Topic[Any]] = [self._topic] if self._topic is not None else []
        if self._sync is not None:
            topics = list(self._sync._topics.values())
        counts.skipped = self._passed_over + sum(topic.counts.skipped for topic in topics)
        counts.lost = sum(topic.counts.lost for topic in topics)

    def close(self) -> None:
        for one in (self._topic, self._sync):
            if one is not None:
                one.close()


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """TERM ends the block as Ctrl-C does, and both end it in silence."""
    before = None
    if threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            yield
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)


def run(
    program: Program,
    *,
    lockstep: str | None = None,
    domain: str | None = None,
    timeout: float = 60.0,
    n: int | None = None,
) -> RunCounts:
    """Runs a program until INT, TERM or, if `n` is given, `n` ticks; returns what it did.

    Its `warm_up` comes first, then the inputs are opened, which may take up to `timeout` seconds to
    appear, then the outputs: a topic with a writer says that the program is ready. With `lockstep`,
    or with this key in `params()`, it joins lockstep under that name and works on every frame; the
    world stands still meanwhile. Otherwise it takes the newest frames. Raises `ValueError` for a
    program without inputs or outputs, `GantryError` as `gantry.open`, `gantry.publish` and
    `gantry.lockstep`, and whatever `work` raises.
    """
    outputs = outputs_of(program)
    _check_inputs(program)
    place = params().get("lockstep") if lockstep is None else lockstep
    if place is not None and not isinstance(place, str):
        raise GantryError(f"params.lockstep is {place!r}; it is the name under which this program joins, a text")
    counts = RunCounts()
    with _ended_by_signals(), contextlib.ExitStack() as stack:
        program.warm_up()
        inputs = _Inputs(list(dict.fromkeys(program.inputs.values())), domain, timeout, newest=place is None and not program.every)
        stack.callback(inputs.close)
        stack.callback(inputs.count, counts)
        publishers = {one.topic: stack.enter_context(_opened(one, domain)) for one in outputs}
        gate = stack.enter_context(lockstep_as(place, domain, timeout)) if place is not None else None
        for samples in _samples(inputs, gate):
            _answer(program, publishers, samples, counts)
            del samples
            if n is not None and counts.worked >= n:
                break
    return counts


def run_file(
    program: Program,
    recording: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    start: float = 0.0,
    end: float | None = None,
) -> RunCounts:
    """Runs a program over a recording, from `start` to `end` in simulated seconds, and keeps its results in `out` beside it.

        gantry.bench.run_file(detect, "drive.mcap", "boxes.mcap")

    It works on every tick of which each input has a frame or a result; nothing is lost, and no clock
    runs. Returns what it did. Raises `GantryError` as `gantry.Recording`, `Recording.sync` and
    `Recording.writer`, `ValueError` for a program without inputs or outputs, and whatever `work` raises.
    """
    outputs, counts = outputs_of(program), RunCounts()
    _check_inputs(program)
    program.warm_up()
    with Recording(recording) as drive:
        rows = drive.sync(list(dict.fromkeys(program.inputs.values())), start, end)
        with drive.writer(out) as file:
            publishers = {
                one.topic: file.publish(one.topic, one.type, classes=one.classes, fields=one.fields, bones=one.bones, schema=one.schema, note=one.note)
                for one in outputs
            }
            for row in rows:
                _answer(program, publishers, row, counts)
    return counts


def _check_inputs(program: Program) -> None:
    if not program.inputs:
        raise ValueError(f"{program.name()} has no inputs; name at least one topic, for example inputs={{'image': 'ego/front/rgb'}}")


def _opened(output: Output, domain: str | None) -> Publisher:
    return publish(
        output.topic,
        output.type,
        domain=domain,
        classes=output.classes,
        fields=output.fields,
        bones=output.bones,
        schema=output.schema,
        note=output.note,
    )


def _samples(inputs: _Inputs, gate: Lockstep | None) -> Iterator[Samples]:
    if gate is None:
        while True:
            samples = inputs.next(None)
            if samples is not None:
                yield samples
            del samples
    while True:
        gate.next(None)
        gate.wait_frames()
        while (samples := inputs.next(0.0)) is not None:
            yield samples
            del samples


def _answer(program: Program, publishers: Mapping[str, Publisher], samples: Samples, counts: RunCounts) -> None:
    frames = {name: samples[topic] for name, topic in program.inputs.items()}
    began = time.monotonic()
    found = program.work(**frames)
    counts.work_secs += time.monotonic() - began
    counts.worked += 1
    if found is None:
        return
    counts.answered += 1
    if len(publishers) == 1 and not (isinstance(found, dict) and found.keys() == publishers.keys()):
        found = {next(iter(publishers)): found}
    if not isinstance(found, dict):
        raise ValueError(f"{program.name()} returned {type(found).__name__}; with several outputs it returns a dictionary from topic to result")
    unknown = set(found) - set(publishers)
    if unknown:
        raise ValueError(f"{program.name()} returned {', '.join(map(repr, sorted(unknown)))}; its outputs are {', '.join(publishers)}")
    for topic, data in found.items():
        publisher = publishers[topic]
        publisher.send(_nothing(publisher.type) if _is_empty(data) else data, answers=list(frames.values()))


def _is_empty(data: Any) -> bool:
    """Whether it is an empty list, which stands for no records."""
    return isinstance(data, (list, tuple)) and not data


def _nothing(type_: str) -> Any:
    """Returns no records of a type."""
    if type_ in TAILS:
        return _records.RecordsAndTail(np.zeros(0, RECORDS[type_]), np.zeros(0, TAILS[type_]))
    return np.zeros(0, RECORDS[type_]) if type_ in RECORDS else []
