"""A Dask cluster on this machine gives what the local pool gives, also where a worker or the scheduler is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest
import yaml

from fmu_didim.campaigns.campaign import campaign
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.running.store import Store
from tests.campaigns.test_resume import CONTENT, begun, table
from tests.conftest import package
from tests.helpers import ROOT
from tests.patience import patience, wait_until

package("distributed")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore"}
DASK = [sys.executable, "-m", "dask"]


@contextmanager
def process(*command: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is ended, with those that it has started."""
    with log.open("wb") as stream:
        child = subprocess.Popen(
            [*DASK, *command], env=ENVIRONMENT, stdout=stream, stderr=stream, start_new_session=True
        )
    try:
        yield child
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[Path, list[subprocess.Popen[bytes]]]]:
    """The scheduler file, and scheduler and two workers."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    loopback = ("--host", "127.0.0.1", "--scheduler-file", str(file))
    with process("scheduler", *loopback, "--port", "0", "--no-dashboard", log=folder / "scheduler.log") as scheduler:
        wait_until(file.is_file, "scheduler")
        options = ("--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1",
                   "--death-timeout", f"{patience(60):g}", "--local-directory", str(folder))  # fmt: skip
        with (
            process("worker", *options, "--name", "one", log=folder / "one.log") as one,
            process("worker", *options, "--name", "two", log=folder / "two.log") as two,
        ):
            for log in (folder / "one.log", folder / "two.log"):
                wait_until(lambda log=log: b"Registered to" in log.read_bytes(), f"worker of {log.name}")
            yield file, [scheduler, one, two]


def count(out: Path) -> int:
    return len(Store(out).rows(())) if out.is_dir() else 0


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """What the local pool gives."""
    out = tmp_path_factory.mktemp("local") / "run"
    campaign(CONTENT, out).run(workers=2)
    return table(out)


@pytest.mark.slow
def test_the_same_as_here(local: pd.DataFrame, tmp_path: Path) -> None:
    with cluster(tmp_path) as (file, _):
        campaign(CONTENT, tmp_path / "run").run(scheduler=str(file))
    pd.testing.assert_frame_equal(table(tmp_path / "run"), local)


@pytest.mark.slow
def test_a_worker_killed_then_the_scheduler(local: pd.DataFrame, tmp_path: Path) -> None:
    """The campaign outlives a worker; of the scheduler's end it says what to do, and goes on with the next one."""
    out, file = tmp_path / "run", tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump({**CONTENT, "seeds": 40}))
    with cluster(tmp_path) as (address, (scheduler, one, _)):
        runner = begun(file, out, "--scheduler", str(address))
        wait_until(lambda: count(out) > 0, "row")
        os.killpg(one.pid, signal.SIGKILL)
        before = count(out)
        wait_until(lambda: count(out) > before + 4, "row after the worker's end")
        os.killpg(scheduler.pid, signal.SIGKILL)
        said = runner.communicate(timeout=patience(200))[0].decode()
        assert runner.returncode == 1, said
        assert "The cluster is lost" in said
        assert "not run again" in said
    stored = count(out)
    assert 0 < stored < 80
    with cluster(tmp_path) as (address, _):
        runner = begun(file, out, "--scheduler", str(address))
        said = runner.communicate(timeout=patience(400))[0].decode()
        assert runner.returncode == 0, said
    found = table(out)
    assert len(found) == 80
    assert (found["status"] == "answered").all()
    both = found.merge(local, on="id", suffixes=("", "_local"))
    assert len(both) == 12
    assert (both["ZZ2"] == both["ZZ2_local"]).all()
    assert Results(Store(out)).status().open == 0


@pytest.mark.gate
def test_no_scheduler_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fmu_didim.base.errors import InputError
    from fmu_didim.campaigns.running import cluster

    monkeypatch.setattr(cluster, "SCHEDULER_S", patience(2))
    with pytest.raises(InputError, match="No scheduler answers there"):
        campaign(CONTENT, tmp_path / "run").run(scheduler="tcp://127.0.0.1:9")
