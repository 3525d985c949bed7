"""Count our modules that a command loads in its own process, and list them with --list."""

import argparse
import subprocess
import sys

OURS = ("harness", "triangulators", "scenes")
TELL = (
    "import atexit, sys\n"
    "atexit.register(lambda: print(*sorted(m for m in sys.modules if m.split('.')[0] in "
    f"{OURS!r}), sep='\\n', file=sys.stderr))\n"
    "from harness.cli import main\n"
    "main()\n"
)


def main() -> None:
    """Read the command line and run the command that follows `--`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("command", nargs="+")
    chosen = parser.parse_args()
    done = subprocess.run(
        [sys.executable, "-c", TELL, *chosen.command], capture_output=True, text=True, check=False
    )
    lines = done.stderr.splitlines()
    found = [line for line in lines if line.split(".")[0] in OURS and " " not in line]
    if chosen.list:
        print(*found, sep="\n")
    print(f"{len(found)} modules, exit code {done.returncode}: {' '.join(chosen.command)}")


if __name__ == "__main__":
    main()
