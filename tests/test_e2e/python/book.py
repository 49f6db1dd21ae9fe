"""Runs the commands of a page in order, in an empty home, as somebody who reads the page would.

    book.py PAGE HOME [PROJECT]

The files of a project lie in the home, too.

Each ```sh block is run by bash; comments of the page, which readers do not see, say what else is to be known. Before a block:

    <!-- file: NAME -->              the block is no command; it is saved under this name
    <!-- not run: REASON -->         the block cannot be run here
    <!-- shows: TEXT -->             the block's output holds this text
    <!-- terminal: N; until: TEXT --> the block is one command, which goes on in terminal N; it has said TEXT when the page goes on
    <!-- then: TEXT -->              afterwards, some terminal says this text anew

and anywhere `<!-- ctrl-c: N -->`: terminal N gets Ctrl-C, and its program has to end with code 0; with `after: M ticks` once the world
has gone on for so long, and with `or code: C` another code is right, too.

Ports that pages name are replaced by free ones, so that nothing else of the machine is met. The last line printed counts what was done.
"""

import contextlib
import ctypes
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

#: Far longer than anything takes, so that only a hang reaches it, seconds.
PATIENCE_SECS = 240.0
COMMENT = re.compile(r"<!--\s*(.*?)\s*-->")
KEYS = ("file", "not run", "shows", "terminal", "until", "then", "ctrl-c", "after", "or code")
#: Ports in pages: of CARLA's calls, whose streams are at the next one, and of its Traffic Manager.
PORTS = ("2000", "8000")


LIBC, PR_SET_PDEATHSIG = ctypes.CDLL(None), 1


class Failed(Exception):
    """What was otherwise than the page says."""


def keys(comment):
    """The keys of a comment; a reason runs to its end."""
    found = {}
    for part in [comment] if comment.startswith("not run:") else comment.split("; "):
        key, colon, value = part.partition(":")
        if not colon or key.strip() not in KEYS:
            raise Failed(f"the comment {comment!r} is not understood; keys are {', '.join(KEYS)}")
        found[key.strip()] = value.strip()
    return found


def steps(text):
    """The blocks and comments of a page in order: (line, language or None, text, keys)."""
    pending, block = {}, None
    for number, line in enumerate(text.splitlines(), 1):
        if block is not None:
            if line.strip() == "```":
                yield block[0], block[1], "\n".join(block[2]) + "\n", pending
                pending, block = {}, None
            else:
                block[2].append(line)
        elif line.startswith("```"):
            block = (number, line[3:].strip(), [])
        elif comment := COMMENT.fullmatch(line.strip()):
            found = keys(comment[1])
            if "ctrl-c" in found:
                yield number, None, "", found
            else:
                pending = found
        elif line.strip():
            pending = {}


def free_ports():
    """A free port for each of PORTS, with the next one free as well, below those that the kernel gives to connections."""
    # A page that runs beside this one begins at another place.
    taken, place = {}, os.getpid()
    for number, name in enumerate(PORTS):
        while name not in taken:
            port = 20_000 + 4 * (place % 3_000) + 2 * number
            place += 7
            with socket.socket() as one, socket.socket() as next_one:
                with contextlib.suppress(OSError):
                    one.bind(("127.0.0.1", port))
                    next_one.bind(("127.0.0.1", port + 1))
                    taken[name] = str(port)
    return taken


class Running:
    """A command with its output, in a group of processes of its own, as in a terminal."""

    def __init__(self, command):
        self.lines, self.command = [], command
        self.process = subprocess.Popen(
            ["bash", "-euo", "pipefail", "-c", command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            # Ends with this script, however that ends.
            preexec_fn=lambda: LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM),
        )
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))

    def output(self):
        return "\n".join(self.lines)

    def says(self, text, since=0):
        return any(text in line for line in self.lines[since:])

    def ended(self, what, codes=frozenset([0])):
        """Waits for the end and asks for one of these codes."""
        try:
            code = self.process.wait(PATIENCE_SECS)
        except subprocess.TimeoutExpired:
            self.kill()
            raise Failed(f"{what} still ran after {PATIENCE_SECS:.0f} s; it said:\n{self.output()}") from None
        # A program that it left behind may hold the pipe.
        self.reader.join(10)
        if code not in codes:
            raise Failed(f"{what} ended with code {code}; it said:\n{self.output()}")

    def kill(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()


class Page:
    def __init__(self, path):
        self.text = path.read_text()
        self.terminals, self.ports = {}, free_ports()
        self.n_run, self.n_files, self.left_out = 0, 0, []

    def own_ports(self, text):
        for port, free in self.ports.items():
            text = re.sub(rf"\b{port}\b", free, text)
        return text

    def run(self):
        try:
            for number, language, text, said in steps(self.text):
                self.step(f"line {number}", language, self.own_ports(text), said)
            for name in list(self.terminals):
                raise Failed(f"terminal {name} still runs at the end of the page")
        finally:
            for terminal in self.terminals.values():
                terminal.kill()

    def step(self, where, language, text, said):
        started = time.monotonic()
        if "ctrl-c" in said:
            if "after" in said:
                world_goes_on(int(said["after"].removesuffix(" ticks")))
            self.end(where, said["ctrl-c"], {0, int(said.get("or code", 0))})
        elif "file" in said:
            path = pathlib.Path(said["file"])
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            self.n_files += 1
            return
        elif language == "sh":
            if "not run" in said:
                if not said["not run"]:
                    raise Failed(f"{where}: a block that is not run needs a reason")
                self.left_out.append(f"{where}: {said['not run']}")
                return
            self.command(where, text, said)
            self.n_run += 1
        else:
            if said:
                raise Failed(f"{where}: {said} stands before a block that is no command")
            return
        print(f"{where}: {time.monotonic() - started:.1f} s", flush=True)

    def command(self, where, text, said):
        own_configurations()
        self.check_terminals(where)
        marks = {name: len(terminal.lines) for name, terminal in self.terminals.items()}
        if "terminal" in said:
            (line,) = [line for line in text.splitlines() if line.strip()]
            if said["terminal"] in self.terminals:
                raise Failed(f"{where}: terminal {said['terminal']} is busy")
            running = Running(f"exec {line}")
            self.terminals[said["terminal"]] = running
            self.wait(where, said["until"], {said["terminal"]: 0})
            return
        running = Running(text)
        try:
            running.ended(f"{where}: {text.strip()}")
        finally:
            running.kill()
        if "shows" in said and said["shows"] not in running.output():
            raise Failed(f"{where}: {said['shows']!r} is not in the output of {text.strip()}:\n{running.output()}")
        if "then" in said:
            self.wait(where, said["then"], marks)

    def check_terminals(self, where):
        for name, terminal in self.terminals.items():
            if terminal.process.poll() is not None:
                raise Failed(f"{where}: terminal {name} has ended by itself; it said:\n{terminal.output()}")

    def wait(self, where, text, marks):
        """Waits until one of the terminals has said the text after its mark."""
        deadline = time.monotonic() + PATIENCE_SECS
        while not any(self.terminals[name].says(text, since) for name, since in marks.items()):
            self.check_terminals(where)
            if time.monotonic() > deadline:
                said = "\n".join(self.terminals[name].output() for name in marks)
                raise Failed(f"{where}: waited in vain for {text!r}; said was:\n{said}")
            time.sleep(0.02)

    def end(self, where, name, codes):
        if name not in self.terminals:
            raise Failed(f"{where}: there is no terminal {name}")
        self.check_terminals(where)
        terminal = self.terminals.pop(name)
        os.killpg(terminal.process.pid, signal.SIGINT)
        terminal.ended(f"{where}: {terminal.command}", codes)


def world_goes_on(n_ticks):
    """Waits until the world of this domain has made so many ticks more."""
    import gantry

    until, deadline = None, time.monotonic() + PATIENCE_SECS
    while True:
        # A world that waits for somebody sends nothing.
        with contextlib.suppress(gantry.GantryError):
            tick = gantry.snapshot().tick
            until = tick + n_ticks if until is None else until
            if tick >= until:
                return
        if time.monotonic() > deadline:
            raise Failed(f"the world did not go on for {n_ticks} ticks")
        time.sleep(0.05)


def own_configurations():
    """Gives projects below this folder the private shared memory that it has itself, if any."""
    own = pathlib.Path("config/iceoryx2.toml")
    if own.exists():
        for launch in pathlib.Path().glob("*/launch.toml"):
            (launch.parent / "config").mkdir(exist_ok=True)
            shutil.copy(own, launch.parent / "config")


def main():
    page = Page(pathlib.Path(sys.argv[1]).resolve())
    home = pathlib.Path(sys.argv[2])
    if pathlib.Path("config/iceoryx2.toml").exists() and not home.samefile("."):
        (home / "config").mkdir(exist_ok=True)
        shutil.copy("config/iceoryx2.toml", home / "config")
    for project in sys.argv[3:]:
        shutil.copytree(project, home, dirs_exist_ok=True)
    os.chdir(home)
    try:
        page.run()
    except Failed as failed:
        sys.exit(f"{sys.argv[1]}: {failed}")
    for reason in page.left_out:
        print("not run:", reason)
    print(f"{page.n_run} blocks were run, {page.n_files} files written, {len(page.left_out)} blocks not run")


if __name__ == "__main__":
    main()
