"""Runs a program in a terminal of its own, whose keys are this script's standard input.

    in_terminal.py COLUMNS ROWS PROGRAM [ARGUMENT ...]

What the program shows goes to standard output; a last line says how it ended, and whether the terminal is as it was before.
"""

import fcntl
import os
import pty
import select
import struct
import sys
import termios

LOOK_SECS = 0.02
MOST_BYTES = 64 * 1024


def begin(terminal, program):
    """Becomes the program, first process of a session that the terminal controls."""
    os.setsid()
    fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)
    for standard in range(3):
        os.dup2(terminal, standard)
    os.closerange(3, 64)
    os.execvp(program[0], program)


def relay(master, sources):
    """Hands on what is there to hand on; whether there was anything to show."""
    ready = select.select(sources, [], [], LOOK_SECS)[0]
    if master in ready:
        os.write(1, os.read(master, MOST_BYTES))
    if 0 in ready:
        keys = os.read(0, MOST_BYTES)
        if keys:
            os.write(master, keys)
        else:
            sources.remove(0)
    return master in ready


def main():
    columns, rows, *program = sys.argv[1:]
    master, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", int(rows), int(columns), 0, 0))
    before = termios.tcgetattr(terminal)
    child = os.fork()
    if child == 0:
        begin(terminal, program)
    sources, ended = [master, 0], 0
    while not ended:
        relay(master, sources)
        ended, status = os.waitpid(child, os.WNOHANG)
    while relay(master, [master]):
        pass
    same = termios.tcgetattr(terminal) == before
    print(f"\nended with {os.waitstatus_to_exitcode(status)}, terminal {'as before' if same else 'changed'}", flush=True)


main()
