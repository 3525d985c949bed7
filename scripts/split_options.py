"""Print the options in an environment variable on separate lines, split as a shell splits them.

    RUN="--scene 'my town.gpkg'" python scripts/split_options.py RUN

An unclosed quote is an error (exit code 2), because options would be lost without notice.
"""

import os
import shlex
import sys


def main() -> None:
    """Split the variable that the first argument names."""
    name = sys.argv[1]
    try:
        options = shlex.split(os.environ[name])
    except ValueError as error:
        print(f"error: input {name.lower()}: {error}: {os.environ[name]}", file=sys.stderr)
        sys.exit(2)
    if any("\n" in word for word in options):
        print(f"error: input {name.lower()}: a line break inside quotes", file=sys.stderr)
        sys.exit(2)
    sys.stdout.writelines(f"{option}\n" for option in options)


if __name__ == "__main__":
    main()
