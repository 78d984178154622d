"""Tries the package with the lowest and the newest versions of what it needs, and keeps what was tried.

    python -m tests.tools.versions lowest        # the versions that pyproject.toml states as lowest: must pass
    python -m tests.tools.versions newest        # the newest, not yet released ones among them: tells, never fails
    python -m tests.tools.versions here          # those of this environment; further arguments choose other tests
    python -m tests.tools.versions readme        # the first block of the README, in a clone with nothing beside it
    python -m tests.tools.versions constraints   # writes constraints.txt: the versions of this environment
    python -m tests.tools.versions wheels        # writes docs/figures/wheels.json: for which systems there are wheels
    python -m tests.tools.versions sizes         # writes docs/figures/sizes.json: how large the packages are

``--record`` keeps what came out in docs/figures/platforms.json, which docs/platforms.md shows.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import Distribution, distributions
from pathlib import Path
from tempfile import TemporaryDirectory

from packaging.specifiers import SpecifierSet

from fmu_didim.base.version import __version__
from tests.tools.versions import sizes, suite, wheels
from tests.tools.versions.environments import CONSTRAINTS, MissingToolError, normal, with_lowest, with_newest

COMMAND = "python -m tests.tools.versions constraints"
PYTHON = ".".join(map(str, sys.version_info[:2]))
NOT_PINNED = frozenset({"pip", "setuptools", "wheel", "fmu-didim"})
"""What comes with an environment, and the package itself."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point: 0 where the tests pass; always for the newest versions."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.versions", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("lowest", "newest", "here", "readme", "constraints", "wheels", "sizes"))
    parser.add_argument("--record", action="store_true", help="keep what came out for docs/platforms.md")
    parser.add_argument("--versions", default="newest releases", help="with here: the versions in words")
    options, tests = parser.parse_known_args(arguments)
    try:
        if options.what == "constraints":
            if late := asking_for_more(distributions()):
                parser.exit(1, f"Install older ones, these need more than Python {PYTHON}.0: {', '.join(late)}\n")
            return write_constraints()
        if options.what == "wheels":
            wheels.record()
            return 0
        if options.what == "sizes":
            sizes.record()
            return 0
        row = _row(options.what, tests or suite.SMOKE, options.versions)
    except MissingToolError as error:
        parser.exit(1, f"{error}\n")
    except subprocess.CalledProcessError as error:
        print(f"The environment could not be made: {error}", file=sys.stderr)
        return 0 if options.what == "newest" else 1
    if options.record:
        suite.record(row)
    print(f"{options.what}: exit code {row['exit']}, {row['seconds']} s, Python {row['python']}, {row['packages']}")
    return 0 if options.what == "newest" else int(row["exit"])


def _row(what: str, tests: Sequence[str], versions: str) -> suite.Row:
    if what == "readme":
        return suite.readme()
    if what == "here":
        return suite.run(sys.executable, tests, which=versions)
    made: Callable[[Path], Path] = with_lowest if what == "lowest" else with_newest
    with TemporaryDirectory() as folder:
        return suite.run(made(Path(folder) / "env"), tests, which="lowest" if what == "lowest" else "pre-releases")


def write_constraints(file: Path = CONSTRAINTS) -> int:
    """Write all packages of this environment with their versions."""
    versions = {normal(d.name): d.version for d in distributions()}
    lines = [f"{name}=={version}" for name, version in sorted(versions.items()) if name not in NOT_PINNED]
    head = [
        f"# The versions with which fmu_didim {__version__} was tested on Python {PYTHON}. To have the same:",
        "#     pip install -c constraints.txt .",
        f"# Written by  {COMMAND}  in the environment of the tests.",
    ]
    file.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")
    return 0


def asking_for_more(of: Iterable[Distribution]) -> list[str]:
    """Packages that ask for a later patch of Python than the first one, which systems may not have: Debian 12 has
    3.11.2."""
    asked = {f"{normal(d.name)} {d.version}": d.metadata.get("Requires-Python") or "" for d in of}
    return sorted(f"{name} ({python})" for name, python in asked.items() if f"{PYTHON}.0" not in SpecifierSet(python))


if __name__ == "__main__":
    sys.exit(main())
