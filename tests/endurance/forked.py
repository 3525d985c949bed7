"""The program, loaded once and forked for each input: a second of loading each would be an hour.

    python -m tests.endurance.forked SOCKET

One that is asked forks, gives its output to the pipe that came with the request, and is the program
from there on: its folder, its arguments, its exit code.
"""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.paths import ROOT

MOST = 1 << 20
"""Bytes of a request."""


class Program:
    """A loaded program that can be run again and again, one input at a time.

    It ends with the process that has loaded it.
    """

    def __init__(self) -> None:
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket = ours
        subprocess.Popen(
            [sys.executable, "-m", "tests.endurance.forked", str(its.fileno())],
            cwd=ROOT,
            pass_fds=[its.fileno()],
        )
        its.close()

    def start(self, arguments: list[str], folder: Path, environment: dict[str, str]) -> Any:
        """Return the pid of a new one, and the end of the pipe that says what it says."""
        reading, writing = os.pipe()
        request = json.dumps([arguments, str(folder), environment]).encode()
        socket.send_fds(self._socket, [request], [writing])
        os.close(writing)
        return int(self._socket.recv(64)), os.fdopen(reading, "rb", buffering=0)

    def wait(self) -> int:
        """Return its exit code, less than 0 for a signal, once it has ended."""
        return int(self._socket.recv(64))


def serve(number: int) -> None:
    """Answer requests until nobody can make any."""

    asked = socket.socket(fileno=number)
    while True:
        request, descriptors, _, _ = socket.recv_fds(asked, MOST, 1)
        if not request:
            return
        if (pid := os.fork()) == 0:
            asked.close()
            _be(*json.loads(request), descriptors[0])
        os.close(descriptors[0])
        asked.send(str(pid).encode())
        asked.send(str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())


def _be(arguments: list[str], folder: str, environment: dict[str, str], output: int) -> None:
    """Be the program; does not return."""
    os.setsid()  # what it kills with its group is its own
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for descriptor in (1, 2):
        os.dup2(output, descriptor)
    os.close(output)
    os.environ.update(environment)
    os.chdir(folder)
    sys.argv = ["raster-harness", *arguments]
    sys.path.insert(0, folder)
    from harness.__main__ import main

    try:
        main()
        code: Any = 0
    except SystemExit as error:
        code = error.code
    sys.stdout.flush()
    os._exit(code if isinstance(code, int) else 0 if code is None else 1)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
