"""A process that a test has started, with what it prints."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from typing import Mapping, Sequence

from .._errors import GantryError

#: Seconds that a test waits for anything; far longer than all takes, so that only a hang reaches it.
PATIENCE_SECS = 120.0
_LOOK_SECS = 0.005
#: Ends of a program that was asked to end by a signal: 0, by the signal, and what shells make of that.
_FINE = {0, -signal.SIGINT, 128 + signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGTERM}


def _heed_interrupts() -> None:
    """A shell lets what it starts in the background ignore Ctrl-C, which would go on to programs and keep them from ending."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Program:
    """A running process. `Simulator.run` makes it, and ends it with the simulator."""

    def __init__(self, words: Sequence[str], folder: str, environment: Mapping[str, str]) -> None:
        #: The command.
        self.words: list[str] = list(words)
        #: Lines of stdout and stderr in the order they came.
        self.lines: list[str] = []
        try:
            self._process = subprocess.Popen(
                self.words,
                cwd=folder,
                env={**os.environ, "NO_COLOR": "1", "PYTHONUNBUFFERED": "1", **environment},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                preexec_fn=_heed_interrupts if signal.getsignal(signal.SIGINT) == signal.SIG_IGN else None,
            )
        except OSError as cause:
            raise GantryError(f"{self.words[0]} cannot be started: {cause}") from cause
        self._reader = threading.Thread(target=self._collect, daemon=True)
        self._reader.start()

    def __repr__(self) -> str:
        return f"<gantry.testing.Program {' '.join(self.words)} pid={self.pid}>"

    def _collect(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self.lines.append(line.rstrip("\n"))

    @property
    def name(self) -> str:
        """First word of the command, without its folder."""
        return os.path.basename(self.words[0])

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def output(self) -> str:
        """All that it has printed so far."""
        return "\n".join(self.lines)

    @property
    def exit_code(self) -> int | None:
        """How it ended, negative for a signal; None while it runs."""
        return self._process.poll()

    def wait_line(self, text: str, timeout: float = PATIENCE_SECS) -> str:
        """Waits for a line that contains `text`, and returns it.

        Raises `GantryError` with its output if it ends without, or after `timeout` seconds.
        """
        deadline = time.monotonic() + timeout
        while True:
            ended = self.exit_code is not None
            if ended:
                self._reader.join(PATIENCE_SECS)
            found = next((line for line in list(self.lines) if text in line), None)
            if found is not None:
                return found
            if ended:
                raise GantryError(f"{self.name} ended with {self.exit_code} and never said {text!r}; its output:\n{self.output}")
            if time.monotonic() >= deadline:
                raise GantryError(f"{self.name} did not say {text!r} within {timeout} s; its output:\n{self.output}")
            time.sleep(_LOOK_SECS)

    def wait(self, timeout: float = PATIENCE_SECS) -> int:
        """Waits for its end, and returns the exit code.

        Raises `GantryError` with its output after `timeout` seconds; it is killed then.
        """
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired as cause:
            self.kill()
            raise GantryError(f"{self.name} did not end within {timeout} s and was killed; its output:\n{self.output}") from cause
        self._reader.join(timeout)
        return code

    def stop(self, signal_number: int = signal.SIGINT, timeout: float = PATIENCE_SECS) -> None:
        """Asks it to end as the launcher does, and waits.

        Raises `GantryError` with its output for an exit code that is neither 0 nor that of the
        signal, also if it had ended before, and after `timeout` seconds.
        """
        if self.exit_code is None:
            self._process.send_signal(signal_number)
        code = self.wait(timeout)
        if code not in _FINE:
            raise GantryError(f"{self.name} ended with {code}; its output:\n{self.output}")

    def kill(self) -> None:
        """Kills it as `kill -9` does, and waits until it is gone."""
        self._process.kill()
        self._process.wait()
        self._reader.join(PATIENCE_SECS)

    def check(self) -> None:
        """Raises `GantryError` with its output if it has failed."""
        code = self.exit_code
        if code not in _FINE and code is not None:
            self._reader.join(PATIENCE_SECS)
            raise GantryError(f"{self.name} has ended with {code}; its output:\n{self.output}")
