"""Measure the size of installations in MB: the base and each extra, each in a new environment.

    .venv/bin/python scripts/sizes.py [results/reference/install-sizes.csv]

Packages come from the index that uv is configured for, in the versions of requirements-test.lock if
it has them (not the data of the extras counties and helsinki). Bytecode, which Python adds on the
first import, and the interpreter are not counted.
"""

import csv
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from importlib.metadata import distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
UV = shutil.which("uv") or Path(sys.executable).with_name("uv")
OUT = ROOT / "results" / "reference" / "install-sizes.csv"
NOT_MEASURED = {"docs", "test"}
MIN_MEGABYTES = 5


def build_wheel(folder: Path) -> Path:
    """Build the wheel of the commit HEAD, without uncommitted changes; return the file."""
    source = folder / "source"
    archive = ["git", "-C", ROOT, "archive", "HEAD", "--output", folder / "source.tar"]
    subprocess.run([str(part) for part in archive], check=True)
    source.mkdir()
    subprocess.run(["tar", "-xf", folder / "source.tar", "-C", source], check=True)
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--wheel-dir", str(folder), str(source)], check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def measure(wheel: Path, extra: str) -> dict[str, int]:
    """Return the bytes of each package that the wheel installs with an extra, "" for none."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        lock = (ROOT / "requirements-test.lock").read_text()
        pins = folder / "constraints.txt"
        pins.write_text("\n".join(re.findall(r"^[\w.-]+==.*?(?= \\$)", lock, re.MULTILINE)))
        requirement = f"{wheel}[{extra}]" if extra else str(wheel)
        target = folder / "packages"
        uv = [UV, "pip", "install", "-q", "--python", sys.executable, "--target", target]
        uv += ["--constraint", pins, "--override", ROOT / "overrides.txt", requirement]
        subprocess.run([str(part) for part in uv], check=True)
        return {
            package.metadata["Name"]: sum(
                Path(str(file.locate())).stat().st_size for file in package.files or []
            )
            for package in distributions(path=[str(target)])
        }


def main() -> None:
    """Write a row for the base, for each of its large packages, and for each extra."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else OUT
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    with tempfile.TemporaryDirectory() as folder:
        wheel = build_wheel(Path(folder))
        base = measure(wheel, "")
        rows = [("base", "all", sum(base.values()), len(base))]
        large = sorted(base.items(), key=lambda item: -item[1])
        rows += [("base", name, size, 1) for name, size in large if size >= MIN_MEGABYTES * 1e6]
        for extra in project["optional-dependencies"]:
            if extra not in NOT_MEASURED:
                sizes = measure(wheel, extra)
                added = sum(sizes.values()) - sum(base.values())
                rows.append((extra, "all", added, len(sizes) - len(base)))
    with out.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("extra", "package", "megabytes", "packages"))
        writer.writerows((extra, name, round(size / 1e6, 1), n) for extra, name, size, n in rows)
    print(out.read_text(), end="")


if __name__ == "__main__":
    main()
