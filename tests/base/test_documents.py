"""YAML files: what no description needs is refused soon, in a few words and with its place."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
import yaml

from fmu_didim import identify, load_case
from fmu_didim.base import documents
from fmu_didim.base.documents import LONGEST, MAXIMUM_BYTES, MAXIMUM_DEPTH, MAXIMUM_VALUES, load_yaml, validate
from fmu_didim.base.errors import InputError
from fmu_didim.case.document import read_case
from fmu_didim.cli.main import main
from fmu_didim.data.excitation import Chirp, ChirpJoint
from fmu_didim.dynamics.robot import RobotDescription, read_robot
from tests.cases import scara_case
from tests.patience import Calls


def laughs(levels: int, width: int) -> str:
    lines = ["a0: &a0 [" + ", ".join(["x"] * width) + "]"]
    lines += [f"a{k}: &a{k} [" + ", ".join([f"*a{k - 1}"] * width) + "]" for k in range(1, levels)]
    return "\n".join(lines) + "\n"


def mappings(levels: int, width: int) -> str:
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{k}: &a{k} {{" + ", ".join(f"k{i}: *a{k - 1}" for i in range(width)) + "}" for k in range(1, levels)]
    return "\n".join(lines) + "\n"


PARSERS = list(dict.fromkeys([documents.PythonLoader, documents.LOADER]))
CHAIN = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 60))
ATTACKS = {
    "ten to the ten": (laughs(10, 10), "more than 50000 values, aliases written out"),
    "two to the forty": (laughs(40, 2), "more than 50000 values"),
    "as mappings": (mappings(20, 8), "more than 50000 values"),
    "deep by brackets": ("a: " + "[" * 100_000, "nested more than 50 deep"),
    "deep by braces": ("a: " + "{a: " * 60_000, "nested more than 50 deep"),
    "deep by indentation": ("\n".join(" " * k + "a:" for k in range(600)), "nested more than 50 deep"),
    "deep by dashes": ("a:\n" + "- " * 60_000 + "1", "nested more than 50 deep"),
    "deep by aliases": (CHAIN, "nested more than 50 deep"),
    "in itself": ("a: &a [1, *a]", "stands in what it stands for"),
    "a mapping in itself": ("a: &a {b: *a}", "stands in what it stands for"),
    "many values": ("a: [" + "1," * 100_000 + "1]", "more than 50000 values"),
    "large": ("a: " + "x" * MAXIMUM_BYTES, "too large for a description"),
    "five thousand digits": ("name: x\na: " + "9" * 5000, r"line 2, column 4"),
    "no such day": ("a: 2025-02-30", r"day.*[\s\S]*line 1, column 4"),
    "no tag of ours": ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
    "half of a character": ('a: "\\ud800"', "surrogates not allowed|invalid Unicode character"),
    "no alias": ("a: *b", "undefined alias"),
    "a list as a key": ("? [1, 2]\n: 3", "unhashable key"),
    "a key twice": ("name: x\nrate: 1\nname: y\n", r"'name' occurs twice[\s\S]*line 3, column 1"),
    "a key twice within": ("a:\n  - {b: 1, c: 2, b: 3}", r"'b' occurs twice[\s\S]*line 2"),
    "a truth that is a number": ("1: x\ntrue: y", "True occurs twice"),
    "a number twice": ("a: {1: x, 0x1: y}", "1 occurs twice"),
    "a character of control": ("a: \x01", r"not allowed[\s\S]*the file"),
    "a long key twice": ("? " + "k" * 1000 + "\n: 1\n? " + "k" * 1000 + "\n: 2", "occurs twice"),
}


@pytest.fixture(params=PARSERS)
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> type[Any]:
    """Each of the parsers in turn, whichever is taken on this machine."""
    monkeypatch.setattr(documents, "LOADER", request.param)
    return request.param


@pytest.mark.gate
@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.usefixtures("parser")
def test_what_no_description_needs_is_refused(tmp_path: Path, attack: str) -> None:
    text, told = ATTACKS[attack]
    path = tmp_path / "case.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=told) as caught:
        load_yaml(path)
    assert caught.value.where == str(path)
    assert len(str(caught.value)) < 2000


@pytest.mark.gate
def test_both_parsers_tell_the_same() -> None:
    """Of what is refused for what it holds, to the letter; other words for syntax stand at the same place."""
    told: dict[str, list[str]] = {attack: [] for attack in ATTACKS if attack != "large"}
    for attack in told:
        text, _ = ATTACKS[attack]
        for parser in PARSERS:
            with pytest.raises(yaml.YAMLError) as caught:
                documents.parse_yaml(text, parser)
            told[attack].append(str(caught.value))
    differ = {attack for attack, texts in told.items() if len(set(texts)) > 1}
    assert differ <= {"half of a character", "a character of control"}


@pytest.mark.gate
@pytest.mark.parametrize(("count", "refused"), [(MAXIMUM_VALUES - 3, False), (MAXIMUM_VALUES, True)])
def test_no_more_is_read_than_the_bound(parser: type[Any], count: int, refused: bool) -> None:
    """However long a file is: what is beyond the bound costs nothing."""
    events, next_event = [], parser.get_event
    text = "a: [" + "1," * (count - 1) + "1]"

    class Counted(parser):  # type: ignore[misc]
        def get_event(self) -> Any:
            events.append(1)
            return next_event(self)

    with pytest.raises(yaml.YAMLError, match="more than 50000 values") if refused else nullcontext():
        documents.parse_yaml(text, Counted)
    assert len(events) <= MAXIMUM_VALUES + 10


def test_the_place_of_what_is_not_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_bytes("name: x\ndescription: Prüfstand\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"not UTF-8[\s\S]*line 2[\s\S]*xfc[\s\S]*Save it as UTF-8"):
        load_yaml(path)
    path.write_text("name: Prüfstand\n", encoding="utf-8")
    assert load_yaml(path) == {"name": "Prüfstand"}


@pytest.mark.gate
@pytest.mark.usefixtures("parser")
def test_what_descriptions_use_is_read(tmp_path: Path) -> None:
    """Anchors, merged keys that are overruled, aliases of one value in many places; up to the bounds."""
    path = tmp_path / "case.yaml"
    text = "base: &base {a: 1, b: [2, 3]}\none: {<<: *base, a: 5}\ntwo: [*base, *base]\n1: x\n'1': y\n"
    path.write_text(text)
    base = {"a": 1, "b": [2, 3]}
    expected = {"base": base, "one": {"a": 5, "b": [2, 3]}, "two": [base, base], "1": "y"}
    found = load_yaml(path)
    assert {key: found[key] for key in expected} == expected
    deep = "a: " + "[" * (MAXIMUM_DEPTH - 3) + "1" + "]" * (MAXIMUM_DEPTH - 3)
    path.write_text(deep)
    assert load_yaml(path) == yaml.safe_load(deep)
    path.write_text("a: [" + ",".join(["1"] * (MAXIMUM_VALUES - 3)) + "]")
    assert len(load_yaml(path)["a"]) == MAXIMUM_VALUES - 3


@pytest.mark.usefixtures("parser")
def test_every_description_here_is_read() -> None:
    for path in [*Path("examples").rglob("*.yaml"), *Path("fmus").rglob("*.yaml"), *Path("controllers").glob("*.yaml")]:
        assert load_yaml(path) == yaml.safe_load(path.read_text(encoding="utf-8"))


def test_messages_stay_short_and_cheap() -> None:
    """Values whose text would fill the memory: ten to the ten, as a program may hand them over."""
    many: object = "x"
    for _ in range(10):
        many = [many] * 10
    content = {"name": many, "joints": many, "k" * 100_000: "v" * 100_000, **{f"wrong{k}": many for k in range(500)}}
    tracemalloc.start()
    with pytest.raises(InputError) as caught, Calls() as calls:
        validate(RobotDescription, content, where="robot.yaml")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert calls.count < 1000 * len(content)
    message = str(caught.value)
    assert "and others" in message
    assert "problems" in message
    assert max(len(line) for line in message.splitlines()) < 20 * LONGEST


@pytest.mark.parametrize("attack", ["ten to the ten", "deep by brackets", "a key twice"])
def test_commands_refuse_them_too(tmp_path: Path, capsys: pytest.CaptureFixture[str], attack: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(ATTACKS[attack][0])
    for arguments in (["check", str(path)], ["export", str(path)], ["simulate", str(path)]):
        assert main(arguments) == 1
        assert "The file is not valid YAML" in capsys.readouterr().err


def case_text(**changes: object) -> str:
    joints = [{"amplitude": 0.5}, {"amplitude": 0.3}]
    chirp = {"kind": "chirp", "start_hz": 0.1, "stop_hz": 1.0, "duration_s": 10.0, "joints": joints}
    case = {"name": "x", "robot": "robot.yaml", "controller": {"kind": "model", "source": "controller.yaml"},
            "train": {"reference": chirp | changes, "torque": {"file": "log.csv"}}}  # fmt: skip
    return yaml.safe_dump(case)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (case_text(duration_s=float("inf")), "duration_s: a finite number is needed here"),
        (case_text(start_hz=float("nan")), "start_hz: a finite number is needed here"),
        (case_text() + "loop: {rate_hz: .inf}\n", "rate_hz: a finite number is needed here"),
        (case_text() + "loop: {drive_gains: [1.0, 0.0]}\n", "a drive with the gain 0 moves nothing"),
        (case_text() + "estimator: {kind: didim, tolerance: .nan}\n", "tolerance must be a finite number"),
    ],
)
def test_numbers_that_are_none_are_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "case.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=told):
        read_case(tmp_path / "case.yaml")


def test_gravity_that_is_no_number_is_refused(tmp_path: Path) -> None:
    robot = Path("fmus/scara/robot.yaml").read_text(encoding="utf-8") + "\n"
    assert "gravity" in robot
    changed = re.sub(r"gravity: .*", "gravity: [.nan, 0, 0]", robot)
    (tmp_path / "robot.yaml").write_text(changed, encoding="utf-8")
    with pytest.raises(InputError, match=r"gravity\.0: a finite number is needed here"):
        read_robot(tmp_path / "robot.yaml")


@pytest.mark.parametrize(("seconds", "rate"), [(1e300, 1e3), (1e6, 1e3), (10.0, 1e12), (10.0, 1e300)])
def test_a_motion_longer_than_memory_is_refused(seconds: float, rate: float) -> None:
    motion = Chirp(start_hz=0.1, stop_hz=1.0, duration_s=seconds, joints=(ChirpJoint(amplitude=1.0),))
    with pytest.raises(InputError, match="too long for its rate"):
        motion.trajectory(rate)


def changed_case(folder: Path, entry: str, value: object) -> Path:
    """The SCARA example with another entry of its torque log, its loop or its reference."""
    content = yaml.safe_load(scara_case(folder, plant={"kind": "model"}).read_text(encoding="utf-8"))
    *way, last = entry.split(".")
    place = content
    for key in way:
        place = place.setdefault(key, {})
    place[last] = value
    (folder / "case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder / "case.yaml"


@pytest.mark.gate
@pytest.mark.parametrize(
    ("entry", "value", "told"),
    [
        ("train.torque.rate_hz", 1e12, "The log has fewer samples than that"),
        ("train.torque.rate_hz", 1e300, "The log has fewer samples than that"),
        ("loop.rate_hz", 1e12, "too long for its rate"),
        ("loop.rate_hz", 1e-9, "One instant is no motion"),
        ("train.reference.duration_s", 1e-9, "One instant is no motion"),
        ("loop.delay_s", 1e9, "A delay must be between 0 and 1000 samples"),
        ("loop.drive_gains", [1.0, 2.0, 3.0], "One drive gain is needed for each joint"),
        ("low_pass", {"cutoff_hz": 1e300}, "must lie below half the torque rate"),
    ],
)
def test_numbers_beyond_all_sense_are_refused(tmp_path: Path, entry: str, value: object, told: str) -> None:
    with pytest.raises(InputError, match=told):
        identify(changed_case(tmp_path, entry, value))


def test_a_window_longer_than_the_reference_is_refused(tmp_path: Path) -> None:
    path = changed_case(tmp_path, "train.torque.sampling", "average")
    text = path.read_text(encoding="utf-8").replace("sampling: average", "sampling: average\n    window_s: 1.0e+9")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="window of the averages is longer than the reference"):
        load_case(path)


def test_a_command_needs_a_gain_for_each_joint(tmp_path: Path) -> None:
    path = changed_case(tmp_path, "loop.drive_gains", [1.0, 2.0, 3.0])
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["train"]["torque"]["quantity"] = "command"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InputError, match=r"One drive gain is needed for each joint[\s\S]*2 numbers"):
        load_case(path)


@pytest.mark.parametrize(
    ("read", "file", "told"),
    [
        (load_case, "fmus/scara/robot.yaml", r"This is a robot description[\s\S]*robot: \.\.\."),
        (load_case, "controllers/scara_pd.yaml", r"This is a controller description"),
        (load_case, "examples/campaigns/controller_swap.yaml", r"This is a campaign[\s\S]*campaign run"),
        (read_robot, "examples/scara/identify.yaml", r"This is a case\."),
        (read_robot, "examples/scara/two_payloads.yaml", r"This is a case of several experiments"),
        (read_robot, "controllers/scara_pd.yaml", r"This is a controller description|law: unknown key"),
    ],
)
def test_another_kind_of_file_is_told(read: Callable[[str], object], file: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        read(file)
    assert file.rpartition("/")[2] in str(caught.value)


def test_a_stray_key_makes_no_other_kind(tmp_path: Path) -> None:
    text = Path("examples/scara/identify.yaml").read_text(encoding="utf-8")
    (tmp_path / "case.yaml").write_text(f"{text}law: pd\n", encoding="utf-8")
    with pytest.raises(InputError, match="law: unknown key"):
        load_case(tmp_path / "case.yaml")
