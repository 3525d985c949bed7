"""A server that imports the program once and forks for each input, to save a second each.

    python -m tests.endurance.forked SOCKET

For each request the server forks; the child sends its output to the pipe from the request and runs
the program with the requested folder and arguments.
"""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.paths import ROOT

MAX_REQUEST_BYTES = 1 << 20
"""Size limit of a request."""


class Program:
    """A loaded program that runs repeatedly, and exits with the process that created it."""

    def __init__(self) -> None:
        client, server = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket = client
        subprocess.Popen(
            [sys.executable, "-m", "tests.endurance.forked", str(server.fileno())],
            cwd=ROOT,
            pass_fds=[server.fileno()],
        )
        server.close()

    def start(self, arguments: list[str], folder: Path, environment: dict[str, str]) -> Any:
        """Start the program; return its pid and the read end of the pipe with its output."""
        reading, writing = os.pipe()
        request = json.dumps([arguments, str(folder), environment]).encode()
        socket.send_fds(self._socket, [request], [writing])
        os.close(writing)
        return int(self._socket.recv(64)), os.fdopen(reading, "rb", buffering=0)

    def wait(self) -> int:
        """Wait for the program; return the exit code, negative for a signal."""
        return int(self._socket.recv(64))


def serve_requests(number: int) -> None:
    server = socket.socket(fileno=number)
    while True:
        request, descriptors, _, _ = socket.recv_fds(server, MAX_REQUEST_BYTES, 1)
        if not request:
            return
        if (pid := os.fork()) == 0:
            server.close()
            _run_program(*json.loads(request), descriptors[0])
        os.close(descriptors[0])
        server.send(str(pid).encode())
        server.send(str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())


def _run_program(
    arguments: list[str], folder: str, environment: dict[str, str], output: int
) -> None:
    os.setsid()  # so that killing the process group does not end the tests
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
    serve_requests(int(sys.argv[1]))
