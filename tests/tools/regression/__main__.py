"""Command line of the regression records."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

# Several cases run at once: threads of the linear algebra would only get into each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.conftest import has_emps
from tests.tools.regression.cases import Job, blind_jobs, chosen, example_jobs, make_fixed_cases
from tests.tools.regression.compare import Limits, compare, read_records, text
from tests.tools.regression.record import OtherProjectError, record


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done, and nothing differs that must not; 1: something does; 2: wrong usage."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.regression", description="Records of fixed cases, compared."
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    making = verbs.add_parser("make", help="make the fixed blind cases, one hundred")
    making.add_argument("folder", type=Path)
    making.add_argument("--workers", type=int, default=1, help="processes (1)")
    recording = verbs.add_parser("record", help="run cases and write down what comes out; goes on where it stopped")
    recording.add_argument("folder", type=Path, help="folder of the records, one for each version of the project")
    recording.add_argument("--cases", type=Path, nargs="+", default=[], metavar="DIR",
                           help="folders of blind cases, beside the examples")  # fmt: skip
    recording.add_argument("--every", type=int, default=1, metavar="N", help="each N-th case of these folders (1)")
    recording.add_argument("--only", nargs="+", default=[], metavar="TEXT", help="cases with one of these in the name")
    recording.add_argument("--workers", type=int, default=1, help="processes (1)")
    comparing = verbs.add_parser("compare", help="names, verdicts, parameters and times of two folders of records")
    comparing.add_argument("a", type=Path, metavar="A")
    comparing.add_argument("b", type=Path, metavar="B")
    comparing.add_argument("--limit", type=float, metavar="R", help="largest relative difference of a parameter")
    comparing.add_argument("--sigma", type=float, metavar="S", help="the same in its standard deviations in A")
    options = parser.parse_args(arguments)
    try:
        if options.verb == "make":
            print(f"{make_fixed_cases(options.folder, workers=options.workers)} cases in {options.folder}")
            return 0
        if options.verb == "record":
            return _record(options)
        found = compare(read_records(options.a), read_records(options.b), Limits(options.limit, options.sigma))
    except (FileNotFoundError, ValueError, OtherProjectError) as error:
        parser.error(str(error))
    print(text(found))
    return 0 if found.passed else 1


def _record(options: argparse.Namespace) -> int:
    jobs = chosen([*example_jobs(), *blind_jobs(options.cases, every=options.every)], options.only)
    with tempfile.TemporaryDirectory() as work:
        record(options.folder, _possible(jobs), Path(work), workers=options.workers, progress=_progress)
    return 0


def _possible(jobs: Sequence[Job]) -> list[Job]:
    """The jobs without those whose data are not at hand."""
    absent = [] if has_emps() else [job for job in jobs if " emps/" in job.name]
    if absent:
        _progress(f"left out, the EMPS data are absent: {', '.join(job.name for job in absent)}")
    return [job for job in jobs if job not in absent]


def _progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
