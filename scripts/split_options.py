"""Print the options in an environment variable, one a line, split as a shell splits them.

    RUN="--scene 'my town.gpkg'" python scripts/split_options.py RUN

Ends with 2, in one line, where a quote is not closed: options would be lost in silence.
"""

import os
import shlex
import sys


def main() -> None:
    """Split what the first argument names."""
    name = sys.argv[1]
    try:
        words = shlex.split(os.environ[name])
    except ValueError as error:
        print(f"error: input {name.lower()}: {error}: {os.environ[name]}", file=sys.stderr)
        sys.exit(2)
    sys.stdout.writelines(f"{word}\n" for word in words)


if __name__ == "__main__":
    main()
