"""A simulator in a sandbox: it steps, runs programs, and hands out frames, results and snapshots."""

from __future__ import annotations

import functools
import json
import os
import pathlib
import shutil
import signal
import time
import warnings
from types import TracebackType
from typing import Any, Callable, Mapping, Sequence, TypeVar

from .._actors import spawn
from .._command import command
from .._errors import GantryError, NoSuchTopicError
from .._frame import Frame
from .._load import native
from .._pose import Pose
from .._result import Result
from .._topic import Topic
from .._topics import topics
from .._world import Snapshot, snapshot
from ._program import PATIENCE_SECS, Program
from ._sandbox import Sandbox

_LOOK_SECS = 0.01
T = TypeVar("T")


def find_program(name: str, folder: str | os.PathLike[str] | None = None) -> str:
    """Returns the path of one of Gantry's programs.

    It is in `folder` if that is given, else beside the native module in the checkout that it was
    built in, or on `PATH`. Raises `GantryError` with what to do if it is not.
    """
    built = pathlib.Path(native.__file__ or "").resolve().parent
    places = [str(built), *os.environ.get("PATH", "").split(os.pathsep)] if folder is None else [os.fspath(folder)]
    found = next((path for place in places if place and (path := shutil.which(name, path=place))), None)
    if found is None:
        raise GantryError(
            f"there is no program {name!r} in {', '.join(filter(None, places))}; build Gantry with `cargo build --release "
            "--workspace`, put its programs on PATH, or give their folder: gantry_bin=, or pytest's --gantry-bin"
        )
    return os.path.abspath(found)


class Simulator:
    """A running simulator of one test: a context manager.

    `launch` is a launch file, of which scenario and sensors count; `text` is the text of one
    instead. `set` changes its values, `{"sensor.front.width_px": 160}`. The world stands still
    between the steps of the test, unless `scenario.mode` is set otherwise. `args` are further words
    on `simd`'s command line, `gantry_bin` is the folder of Gantry's programs (else: `find_program`).

    All functions wait up to `PATIENCE_SECS` for what they return, and raise `GantryError` with the
    output of the simulator or of a program as soon as one has failed.
    """

    def __init__(
        self,
        launch: str | os.PathLike[str] | None = None,
        *,
        text: str | None = None,
        set: Mapping[str, Any] | None = None,
        args: Sequence[str] = (),
        gantry_bin: str | os.PathLike[str] | None = None,
    ) -> None:
        if (launch is None) == (text is None):
            raise ValueError("give either a launch file or the text of one")
        simd = find_program("simd", gantry_bin)
        self._sandbox = Sandbox()
        self._topics: dict[str, Topic[Any]] = {}
        #: Programs that `run` has started.
        self.programs: list[Program] = []
        self._open = True
        if text is not None:
            launch = self._sandbox.folder / "launch.toml"
            launch.write_text(text)
        assert launch is not None
        words = [simd, "--launch", os.path.abspath(launch), "--domain", self.domain]
        for key, value in {"scenario.mode": "stepped", **(set or {})}.items():
            words += ["--set", f"{key}={_toml(value)}"]
        try:
            #: The simulator's own process.
            self.daemon: Program = Program([*words, *args], str(self._sandbox.folder), self._sandbox.environment())
        except BaseException:
            self._sandbox.leave()
            raise
        try:
            self.daemon.wait_line("ready")
        except BaseException:
            self._end(check=False)
            raise

    def __enter__(self) -> Simulator:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        # What failed in the block is not hidden behind what that left.
        self._end(check=kind is None)

    def __repr__(self) -> str:
        return f"<gantry.testing.Simulator {self.domain} {'open' if self._open else 'closed'}>"

    @property
    def domain(self) -> str:
        """The domain; programs that `run` starts have it in `GANTRY_DOMAIN`."""
        return self._sandbox.domain

    @property
    def folder(self) -> pathlib.Path:
        """Folder of this test, in which the simulator runs; removed at the end."""
        return self._sandbox.folder

    @property
    def output(self) -> str:
        """What the simulator and all programs have printed."""
        return "\n".join(f"--- {program.name}\n{program.output}" for program in [self.daemon, *self.programs])

    def run(self, *words: str | os.PathLike[str], cwd: str | os.PathLike[str] | None = None, env: Mapping[str, str] | None = None) -> Program:
        """Runs a program in this sandbox: `simulator.run(sys.executable, "-m", "detector", cwd=project)`.

        It starts in the sandbox's folder, where the configuration of shared memory is. With `cwd` it
        starts in a folder of links to everything in `cwd` instead, so that it finds its files; what
        it writes there is gone at the end. `env` is added to the environment.
        """
        folder = self._sandbox.folder if cwd is None else self._sandbox.links_to(cwd)
        program = Program([os.fspath(word) for word in words], str(folder), {**self._sandbox.environment(), "GANTRY_DOMAIN": self.domain, **(env or {})})
        self.programs.append(program)
        return program

    def command(self, *commands: dict[str, Any]) -> list[dict[str, Any]]:
        """Sends commands as `gantry.command`, and returns their replies."""
        return command(*commands, domain=self.domain, timeout=PATIENCE_SECS)

    def step(self, n: int = 1) -> int:
        """Lets `n` ticks pass, and returns the number of the last when everything of it was sent."""
        (reply,) = self.command({"do": "step", "n": n})
        last = int(reply["last_tick"])
        self.wait_until(lambda: self._ticks() >= last or None, f"tick {last} is done")
        return last

    def _ticks(self) -> int:
        (reply,) = self.command({"do": "counters"})
        return int(reply["counters"]["ticks"])

    def watch(self, *names: str) -> None:
        """Waits for topics and opens them, so that `frame` and `result` have what comes from now on.

        Watch a topic before the step whose frame is wanted: a sensor without readers does not fire.
        """
        for name in names:
            if name not in self._topics:
                self._topics[name] = self.wait_until(functools.partial(self._opened, name), f"topic {name} appears")

    def _opened(self, name: str) -> Topic[Any] | None:
        try:
            return Topic(name, self.domain)
        except NoSuchTopicError:
            return None

    def wait_readers(self, name: str, n: int) -> None:
        """Waits until a topic has `n` readers, for example this test and a program that it runs."""
        self.wait_until(lambda: any(topic.name == name and topic.subscribers >= n for topic in topics(self.domain)) or None, f"{name} has {n} readers")

    def frame(self, name: str, tick: int) -> Frame:
        """Returns the frame of `tick` of a topic that is watched; those before it are dropped.

        Raises `GantryError` if a later one comes: the sensor does not fire at every tick, or the
        topic was not watched before the step.
        """
        sample = self._sample(name, tick)
        if not isinstance(sample, Frame):
            raise GantryError(f"{name} has results; use simulator.result")
        return sample

    def result(self, name: str, tick: int) -> Result:
        """Returns the result of `tick` of a topic that is watched; as `frame`."""
        sample = self._sample(name, tick)
        if not isinstance(sample, Result):
            raise GantryError(f"{name} has frames; use simulator.frame")
        return sample

    def _sample(self, name: str, tick: int) -> Any:
        if name not in self._topics:
            raise GantryError(f"{name} is not watched; call simulator.watch({name!r}) before the step")
        topic = self._topics[name]
        while True:
            sample = self.wait_until(lambda: topic.next(0.1, or_none=True), f"{name} has something of tick {tick}")
            if sample.tick > tick:
                raise GantryError(f"{name} has nothing of tick {tick}, the next is of tick {sample.tick}; watch it before the step")
            if sample.tick == tick:
                return sample
            del sample

    def snapshot(self) -> Snapshot:
        """Returns the world after the last tick."""
        done = self._ticks()

        def look() -> Snapshot | None:
            newest = snapshot(self.domain, PATIENCE_SECS)
            return newest if newest.tick >= done else None

        return self.wait_until(look, f"the snapshot of tick {done}")

    def ego(self) -> Any:
        """Returns the record of the ego vehicle, which is spawned before all others, as in `Snapshot.actors`."""
        vehicles = self.snapshot().vehicles
        if len(vehicles) == 0:
            raise GantryError("there is no vehicle; give the launch file an ego vehicle")
        return vehicles[0]

    def spawn_near_ego(self, type_id: str, position_m: Sequence[float]) -> int:
        """Spawns an actor at `position_m` (x forward, y left, z up) from the ego vehicle, turned as it is.

        Returns its id. Raises `GantryError` with the simulator's sentence if it refuses.
        """
        x, y, z = position_m
        return spawn(type_id, Pose.of(self.ego()["world_from_actor"]) @ Pose((x, y, z)), domain=self.domain, timeout=PATIENCE_SECS).id

    def wait_until(self, look: Callable[[], T | None], what: str, timeout: float = PATIENCE_SECS) -> T:
        """Calls `look` until it returns something; `what` is for the message if it never does."""
        deadline = time.monotonic() + timeout
        while True:
            found = look()
            if found is not None:
                return found
            for program in [self.daemon, *self.programs]:
                program.check()
            if self.daemon.exit_code is not None:
                raise GantryError(f"the simulator ended before {what}; its output:\n{self.daemon.output}")
            if time.monotonic() >= deadline:
                raise GantryError(f"waited {timeout} s in vain: {what}\n{self.output}")
            time.sleep(_LOOK_SECS)

    def close(self) -> None:
        """Stops programs and simulator, and removes the sandbox.

        Raises `GantryError` if one of them fails as it ends, or if files are left in shared memory.
        """
        self._end(check=True)

    def _end(self, check: bool) -> None:
        if not self._open:
            return
        self._open = False
        # No name is left that holds one of them.
        while self._topics:
            self._topics.popitem()[1].close()
        failures: list[str] = []
        for program, by in [*((program, signal.SIGINT) for program in reversed(self.programs)), (self.daemon, signal.SIGTERM)]:
            try:
                program.stop(by)
            except GantryError as error:
                failures.append(str(error))
        left, free = self._sandbox.leave()
        if not check:
            return
        if left and free:
            failures.append(f"something is left in /dev/shm: {', '.join(left)}")
        elif left:
            warnings.warn(
                "this process still holds a topic or an array of the simulator, so it cannot be told whether others left something; close it before",
                ResourceWarning,
                stacklevel=3,
            )
        if failures:
            raise GantryError("\n".join(failures))


def _toml(value: Any) -> str:
    """Writes a value as TOML, which JSON is for texts, numbers, truth values and lists."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(one)}" for key, one in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)
