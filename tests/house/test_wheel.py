"""The wheel as a user has it: in other folders, encodings and accounts, without a network; the other ways to install.

It is installed into a fresh environment that finds other packages in the one that runs the tests: no index is asked.
"""

from __future__ import annotations

import os
import shutil
import site
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from fmu_didim import __version__
from fmu_didim.cli.examples import examples
from tests.conftest import ROOT

pytest.importorskip(
    "hatchling", reason="hatchling, which packs the project, is not installed: pip install -e '.[test]'"
)
pytestmark = [
    pytest.mark.gate,
    pytest.mark.skipif(sys.platform == "win32", reason="accounts, encodings and networks as on Linux and macOS"),
]
NOBODY = 65534
"""User and group that own nothing."""
CONDITIONS: Mapping[str, Mapping[str, str]] = {
    "as_it_is": {},
    "c": {"LC_ALL": "C"},
    "cp1252": {"PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0", "LC_ALL": "C.UTF-8"},
}
"""What the surroundings say of encodings."""
FOLDER = "Größe und Lage"
"""Of the user: with a space, with umlauts."""
STUDY = """schema: 1
name: rates
case: identify_200hz.yaml
noise: {relative: 0.05}
vary: {train.torque.rate_hz: [20, 10]}
"""


@dataclass(frozen=True)
class Machine:
    """An environment with the package, and a user.

    Attributes:
        environment: the folder of the environment; home: that of the user.
        before: the command that takes rights and network away, put before each other.
    """

    environment: Path
    home: Path
    before: Sequence[str] = ()

    def run(self, command: str, folder: Path, condition: Mapping[str, str]) -> str:
        """What a command of ours prints that must end well; of the surroundings it knows what is given alone."""
        known = {"HOME": str(self.home), "PATH": f"{self.environment / 'bin'}:/usr/bin:/bin", **condition}
        words = [*self.before, str(self.environment / "bin" / "fmu-didim"), *command.split()]
        done = subprocess.run(words, cwd=folder, env=known, capture_output=True, check=False)
        printed = done.stdout.decode(condition.get("PYTHONIOENCODING", "utf-8"))
        assert done.returncode == 0, f"{command}\n{printed}\n{done.stderr.decode('utf-8', 'replace')}"
        return printed


def installed(environment: Path, package: Path, *, python: str = sys.executable) -> Path:
    """A fresh environment with a package: a wheel, or a folder in which it is installed in place."""
    subprocess.run([python, "-m", "venv", "--without-pip", str(environment)], check=True, capture_output=True)
    base = {"base": str(environment), "platbase": str(environment), "installed_base": str(environment)}
    others = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib"), *site.getsitepackages()}
    own = Path(sysconfig.get_path("purelib", "venv", vars=base))
    (own / "others.pth").write_text("".join(f"{path}\n" for path in sorted(others)), encoding="utf-8")
    given = [str(package)] if package.is_file() else ["--editable", str(package)]
    pip = [sys.executable, "-m", "pip", "--python", str(environment / "bin" / "python"), "install", "--no-index"]
    done = subprocess.run(
        [*pip, "--no-deps", "--no-build-isolation", *given], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return environment


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """A folder that every user can read, as those of pytest are not; wheel and source distribution are in ``dist``."""
    folder = Path(tempfile.mkdtemp(prefix="fmu_didim-wheel-"))
    folder.chmod(0o755)
    try:
        command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder / "dist")]
        built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert built.returncode == 0, built.stderr
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def machine(place: Path) -> Machine:
    """The wheel, and whoever runs the tests."""
    (wheel,) = (place / "dist").glob("*.whl")
    (place / FOLDER).mkdir()
    return Machine(installed(place / "environment", wheel), place / FOLDER)


@pytest.fixture(scope="module")
def stranger(place: Path) -> Machine:
    """The wheel, and somebody who is not root and has no network."""
    is_root = os.geteuid() == 0
    before = ["unshare", "--net", "--", "setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
    before = before if is_root else ["unshare", "--map-current-user", "--net", "--"]
    if (
        shutil.which(before[0]) is None
        or subprocess.run([*before, "true"], capture_output=True, check=False).returncode
    ):
        pytest.skip("this system lets nobody take network and rights away: unshare and setpriv of util-linux, on Linux")
    name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    known = [os.path.realpath(sys.executable), *(f"/usr{local}/bin/{name}" for local in ("", "/local"))]
    usable = [p for p in known if not subprocess.run([*before, "test", "-x", p], check=False).returncode]
    if not usable:
        pytest.skip(f"no other user may run {known[0]}, and there is no {name} in /usr/bin")
    packages = sysconfig.get_path("purelib")
    if subprocess.run([*before, "test", "-x", packages], check=False).returncode:
        pytest.skip(f"no other user may read {packages}: an environment in a folder open to all is needed")
    (wheel,) = (place / "dist").glob("*.whl")
    home = place / f"{FOLDER} 2"
    home.mkdir()
    if is_root:
        os.chown(home, NOBODY, NOBODY)
    return Machine(installed(place / "environment2", wheel, python=usable[0]), home, before)


def example(machine: Machine, name: str, condition: Mapping[str, str]) -> Path:
    """An example, listed and written to a folder of its own."""
    listed = machine.run("example", machine.home, condition)
    assert [known for known in examples() if f"\n  {known} " not in listed] == []
    folder = machine.home / f"{name}-{len(list(machine.home.iterdir()))}"
    told = machine.run(f"example {name} {folder.name}", machine.home, condition)
    assert f"  cd {folder.name}\n  fmu-didim " in told
    return folder


def all_verbs(machine: Machine, condition: Mapping[str, str]) -> None:
    folder = example(machine, "scara", condition)
    found = machine.run("identify identify.yaml", folder, condition)
    assert "VALID: converged" in found and "ZZ1R " in found
    (result,) = folder.glob("results/*identify/result.json")
    assert f'"fmu_didim": "{__version__}"' in result.read_text(encoding="utf-8")
    (machine.home / "rates.yaml").write_text(STUDY.replace("case: ", f"case: {folder.name}/"), encoding="utf-8")
    assert "2 of 2 runs done" in machine.run("campaign run ../rates.yaml", folder, condition)
    arm = example(machine, "arm2r", condition)
    found = machine.run("discover discover.yaml", arm, condition)
    assert "Stribeck friction, joint 1" in found and "Lag of the current loop, joint 2" in found
    assert list(arm.glob("results/*/findings.json"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param("as_it_is", marks=pytest.mark.slow), *(name for name in CONDITIONS if name != "as_it_is")]
)
def test_all_verbs_in_other_encodings(machine: Machine, name: str) -> None:
    all_verbs(machine, CONDITIONS[name])


@pytest.mark.slow
def test_all_verbs_without_rights_and_network(stranger: Machine) -> None:
    all_verbs(stranger, {})


def where(environment: Path) -> list[Path]:
    """Where the package and its examples are, in an environment."""
    code = "import fmu_didim.cli.examples as e; print(e.__file__); print(e.examples_root())"
    command = [environment / "bin" / "python", "-I", "-c", code]
    printed = subprocess.run(command, cwd=environment, capture_output=True, text=True, check=True).stdout
    return [Path(line).resolve() for line in printed.splitlines()]


def test_the_wheel_is_what_runs(machine: Machine) -> None:
    assert all(machine.environment.resolve() in path.parents for path in where(machine.environment))


def test_installed_in_place_it_is_the_project_itself(place: Path) -> None:
    assert where(installed(place / "in_place", ROOT)) == [ROOT / "fmu_didim" / "cli" / "examples.py", ROOT]


def unpacked(archive: Path, folder: Path) -> Path:
    """The one folder of an archive. Filters came with Python 3.11.4; those after 3.11 ask for one."""
    known: dict[str, Any] = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
    with tarfile.open(archive) as packed:
        packed.extractall(folder, **known)
    (source,) = folder.iterdir()
    return source


def test_the_source_distribution_makes_the_same_wheel(place: Path) -> None:
    """Unpacked without git, it is built to a wheel that is the same to the byte."""
    (archive,), (wheel,) = (place / "dist").glob("*.tar.gz"), (place / "dist").glob("*.whl")
    source = unpacked(archive, place / "source")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel"], cwd=source, check=True, capture_output=True
    )
    assert (source / "dist" / wheel.name).read_bytes() == wheel.read_bytes()


@pytest.mark.slow
def test_the_tests_of_the_source_distribution_are_complete(place: Path) -> None:
    """Every test file of it can be read, and those of what is packed pass."""
    (archive,) = (place / "dist").glob("*.tar.gz")
    source = unpacked(archive, place / "tests")
    known = {**os.environ, "PYTHONPATH": str(source)}
    for arguments in (
        ["--collect-only", "-m", ""],
        ["tests/house/test_package_data.py", "tests/cli/test_shipped_examples.py"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *arguments],
            cwd=source, env=known, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout[-3000:]
