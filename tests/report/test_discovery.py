"""The printed text of a discovery (golden) and its page, from made-up findings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.checks.judgement import DiagnosticResult
from fmu_didim.checks.power.statement import MovedResult, PowerResult, StatedResult
from fmu_didim.data.signals import Array, trajectory, write_csv
from fmu_didim.report.discovery.regions import strongest_regions
from fmu_didim.report.discovery.sections import (
    DISCOVERY_FILE,
    discovery_html,
    discovery_report,
    discovery_table,
    write_discovery_report,
)
from fmu_didim.report.discovery.texts import value_line, value_text
from fmu_didim.report.drawing.residual_charts import binned
from fmu_didim.report.sections import Table
from fmu_didim.results.findings import FindingsDocument, ValueFound, load_findings, save_findings
from tests.report.drawn import charts, line

VERDICTS = {
    "nothing": ("good", "NOTHING MISSING", "nothing that matters is missing in the model"),
    "named": ("good", "NAMED", "the missing effects are named"),
    "named_with_remainder": ("doubtful", "NAMED IN PART", "effects are named, part of the gap remains"),
    "unknown": ("refused", "UNKNOWN", "something is missing that no effect of the catalogue explains"),
    "unfinished": ("doubtful", "NOT FINISHED", "the search is not at its end: more or other effects may be missing"),
}


def pair(before: float | None, after: float | None, each: list[tuple[float | None, float | None]]) -> dict[str, Any]:
    return {"before": before, "after": after, "before_per_joint": [b for b, _ in each],
            "after_per_joint": [a for _, a in each]}  # fmt: skip


def stribeck() -> dict[str, Any]:
    return {
        "effect": "stribeck", "title": "Stribeck friction", "class": "stribeck", "joint": 1, "place": "torque balance",
        "equation": "Fs*tanh(dq/v0)*exp(-(dq/vs)^2)",
        "parameters": [
            {"name": "Fs1", "unit": "N.m", "value": 0.8123, "std": 0.0341, "interval": (0.7455, 0.8791)},
            {"name": "vs1", "unit": "rad/s", "value": 0.0853, "std": 0.0118, "interval": (0.0622, 0.1084)},
        ],
        "share_of_gap": 0.617, "delta_bic": 412.3,
        "ambiguous": [
            {"effect": "presliding", "title": "Presliding friction", "joint": 1, "bic_behind": 4.21},
            {"effect": "lugre", "title": "LuGre friction", "joint": 1, "bic_behind": None},
        ],
        "experiment": "Slow constant speeds in both directions, down to a third of vs; reversals at two accelerations.",
        "gap": {
            "estimation": pair(2.104, 1.118, [(2.451, 0.493), (1.683, 1.503)]),
            "validation": pair(2.047, 1.131, [(2.380, 0.521), (1.650, 1.513)]),
        },
        "ratio_interval": (0.631, 0.702),
    }  # fmt: skip


def backlash() -> dict[str, Any]:
    return {
        "effect": "backlash", "title": "Backlash", "class": "backlash", "joint": 2, "place": "structure",
        "equation": "tau = Im*ddq + friction(dq) + tau_s, tau_s = K*dead_zone(q - q_link, gap/2) while in contact",
        "parameters": [
            {"name": "gap2", "unit": "rad", "value": 0.004217, "std": 0.000312, "interval": (0.003605, 0.004829)},
            {"name": "motor_share2", "unit": "1", "value": 0.31, "std": None, "interval": (None, None)},
        ],
        "share_of_gap": 0.334, "delta_bic": 96.7, "ambiguous": [],
        "experiment": "Motions whose transmitted torque changes its sign at different velocities.",
        "gap": {
            "estimation": pair(1.118, 0.384, [(0.493, 0.402), (1.503, 0.365)]),
            "validation": pair(1.131, 0.436, [(0.521, 0.447), (1.513, 0.424)]),
        },
        "ratio_interval": (0.718, 0.803),
    }  # fmt: skip


def region(joint: int, quantity: str, unit: str, low: float, high: float, mean: float, share: float) -> dict[str, Any]:
    return {"joint": joint, "quantity": quantity, "unit": unit, "low": low, "high": high, "mean": mean,
            "share_of_gap": share, "p_value": 1.3e-21}  # fmt: skip


def regions() -> list[dict[str, Any]]:
    """Joint 1 at low speed and after reversals; joint 2 at low load, and in two neighbouring bins of position."""
    return [
        region(1, "velocity", "rad/s", 0.0021, 0.121, 0.803, 0.62),
        region(1, "velocity", "rad/s", -0.118, 0.0021, -0.786, 0.62),
        region(1, "velocity", "rad/s", 0.121, 0.44, 0.114, 0.62),
        region(1, "distance since the last reversal", "rad", 0.0, 0.0214, 0.702, 0.41),
        region(1, "time", "s", 4.0, 5.0, -0.21, 0.04),
        region(1, "acceleration", "rad/s2", 3.0, 4.2, 0.18, 0.02),
        region(2, "load", "N.m", 0.02, 1.31, -0.0412, 0.28),
        region(2, "position", "rad", -0.61, -0.32, 0.0251, 0.113),
        region(2, "position", "rad", -0.32, 0.08, 0.0237, 0.113),
    ]


def document(**changes: Any) -> FindingsDocument:
    """Two effects found on two joints; made by hand."""
    content: dict[str, Any] = {
        "name": "Two-joint arm, torque at 100 Hz", "answer": "named", "text": VERDICTS["named"][2],
        "verdict": "valid", "reasons": [],
        "findings": [stribeck(), backlash()],
        "roles": {"estimation": "estimation", "validation": "validation"},
        "gap": {
            "estimation": pair(2.104, 0.384, [(2.451, 0.402), (1.683, 0.365)]),
            "validation": pair(2.047, 0.436, [(2.380, 0.447), (1.650, 0.424)]),
        },
        "error_percent": {"estimation": (9.614, 4.402), "validation": (9.987, 4.731)},
        "ratio_interval": (0.462, 0.531),
        "noise": {"source": "periods", "std": [0.1712, 0.00651], "correlation": [0.312, 0.104], "period_s": 4.2,
                  "periods": 5},
        "regions": regions(),
        "windows": [{"joint": 2, "begin_s": 3.2, "end_s": 3.45, "torque": 0.0312, "score": 11.6,
                     "experiment": "validation"}],
        "refused": [("dead_zone", 2, "BIC difference 3.1 below 10"),
                    ("torque_ripple", 1, "held-out RMS ratio 0.998, its interval reaches 1.004")],
        "base_parameters": [
            {"name": "ZZ1R", "unit": "kg.m2", "value": 3.4058, "std": 0.01784, "interval": (3.3704, 3.4412)}
        ],
        "regrouping": ["ZZ1R = ZZ1 + Ia1"], "torque_unit": ["N.m", "N.m"], "seconds": 41.7,
        "notes": ["Clock of the log: shifted by 0.2 ms, accounted for."],
        "files": {"robot": "robot_discovered.yaml", "plant_fmu": "plant.fmu"},
        "provenance": {"versions": {"python": "3"}, "options": {"seed": 0}},
    }  # fmt: skip
    return FindingsDocument.model_validate(content | changes)


def answered(answer: str, **changes: Any) -> FindingsDocument:
    content: dict[str, Any] = {"answer": answer, "text": VERDICTS[answer][2], **changes}
    if answer in ("named", "named_with_remainder"):
        return document(**content)
    part = 0.1 if answer == "nothing" else 1.0
    each = [(2.451 * part,) * 2, (1.683 * part,) * 2]
    gap = {label: pair(2.104 * part, 2.104 * part, each) for label in ("estimation", "validation")}
    return document(**content, findings=[], gap=gap, ratio_interval=None,
                    regions=regions() if answer == "unknown" else [])  # fmt: skip


def many(joints: int) -> FindingsDocument:
    """One finding on a robot of that many joints, the odd ones sliding."""
    gaps = [(1.5 + 0.2 * j, 0.3) for j in range(joints)]
    units = ["N.m" if j % 2 == 0 else "N" for j in range(joints)]
    found = stribeck() | {"gap": {"estimation": pair(2.0, 0.3, gaps)}, "ratio_interval": None, "ambiguous": []}
    return document(
        findings=[found], gap={"estimation": pair(2.0, 0.3, gaps)}, error_percent={"estimation": (9.0, 4.0)},
        ratio_interval=None,
        noise={"source": "residual", "std": [0.1] * joints, "correlation": [0.0] * joints, "period_s": None,
               "periods": 1},
        regions=[region(1, "velocity", "rad/s", 0.0, 0.1, 0.8, 0.6)], windows=[], refused=[], torque_unit=units,
    )  # fmt: skip


def several() -> FindingsDocument:
    """The same findings from two experiments that were fitted, and two that were held out."""
    one, other = pair(2.104, 0.384, [(2.451, 0.402), (1.683, 0.365)]), pair(2.047, 0.936, [(2.4, 0.447), (1.6, 1.25)])
    labels = {"slow": "estimation", "with a payload of 5 kg at the wrist": "estimation", "fast": "validation",
              "again": "validation"}  # fmt: skip
    gap = dict(zip(labels, (one, other, one, other), strict=True))
    errors = dict.fromkeys(labels, (9.6, 4.4))
    return document(
        roles=labels, gap=gap, error_percent=errors, windows=[], answer="named_with_remainder",
        text=VERDICTS["named_with_remainder"][2], findings=[stribeck() | {"gap": gap}],
    )  # fmt: skip


def motion(
    joints: int, *, found: float = 0.93, count: int = 2400, rate_hz: float = 100.0, seed: int = 4
) -> dict[str, Array]:
    """Columns of a table of signals; the final model has that part of what the base model lacks: Stribeck friction on
    joint 1, a step at each change of sign of the torque on the others."""
    random = np.random.default_rng(seed)
    time = np.arange(count) / rate_hz
    columns: dict[str, Array] = {"t": time}
    for j in range(1, joints + 1):
        w = 2 * np.pi / 4.2
        q = 0.6 * np.sin(w * time + 0.4 * j) + 0.25 * np.cos(3 * w * time + j)
        dq = w * (0.6 * np.cos(w * time + 0.4 * j) - 0.75 * np.sin(3 * w * time + j))
        size, sigma = (3.0, 0.1712) if j == 1 else (0.2, 0.00651)
        torque = size * (np.sin(q) + 0.3 * np.tanh(dq / 0.05))
        missing = 0.9 * np.tanh(dq / 0.03) * np.exp(-((dq / 0.25) ** 2)) if j == 1 else 0.02 * np.tanh(torque / 0.05)
        columns |= {
            f"measured{j}": torque + missing + sigma * random.standard_normal(count), f"base{j}": torque,
            f"final{j}": torque + found * missing, f"dq{j}": dq, f"q{j}": q,
        }  # fmt: skip
    return columns


def saved(folder: Path, result: FindingsDocument, *, without: tuple[str, ...] = (), count: int = 2400) -> Path:
    """The folder that a discovery leaves: findings.json and the tables of the torques."""
    files = {f"signals_{label}": f"torque_{label}.csv" for label in result.gap}
    for seed, name in enumerate(files.values()):
        columns = motion(len(result.torque_unit), found=0.93 if result.findings else 0.0, count=count, seed=seed)
        time = columns.pop("t")
        kept = {k: v for k, v in columns.items() if k.rstrip("0123456789") not in without}
        write_csv(trajectory(time, kept), folder / name)
    save_findings(result.model_copy(update={"files": {**result.files, **files}}), folder)
    return folder


def page_of(folder: Path) -> str:
    """The page without its script."""
    path = write_discovery_report(folder)
    assert path.name == DISCOVERY_FILE
    text = path.read_text(encoding="utf-8")
    return text[: text.index("</main>")]


def gap_table(result: FindingsDocument) -> Table:
    """Gaps by round and by joint."""
    (table,) = [
        b for s in discovery_report(result).sections for b in s.blocks if s.anchor == "gap" and b.kind == "table"
    ]
    assert isinstance(table, Table)
    return table


GOLDEN = """\
NAMED: The missing effects are named. Joint 1: Stribeck friction (or one of 2 others that these data
  cannot tell from it); joint 2: Backlash. The gap on held-out data falls from 2.05 to 0.44 times
  the noise.
Two-joint arm, torque at 100 Hz

1  Stribeck friction, joint 1 (torque balance)
     Fs1                  (0.812 ± 0.034) N·m, 95 % interval 0.746 to 0.879
     vs1                  (0.085 ± 0.012) rad/s, 95 % interval 0.062 to 0.108
     share of the gap     62 %
     held-out RMS         0.63 to 0.70 of what it was, 95 % interval
     cannot be told from  Presliding friction, joint 1 (BIC 4.2 behind, of 412); LuGre friction,
                          joint 1 (same class)
     to split them        Slow constant speeds in both directions, down to a third of vs; reversals
                          at two accelerations.

2  Backlash, joint 2 (structure)
     gap2                 (0.00422 ± 0.00031) rad, 95 % interval 0.00361 to 0.00483
     motor_share2         (0.31 ± –), not bounded by the data
     share of the gap     33 %
     held-out RMS         0.72 to 0.80 of what it was, 95 % interval
     cannot be told from  nothing in the catalogue
     to confirm it        Motions whose transmitted torque changes its sign at different velocities.

Gap, in times the noise               estimation                   validation
1  Stribeck friction, joint 1         2.10 → 1.12  ██████░░░░░░    2.05 → 1.13  ██████░░░░░░
2  Backlash, joint 2                  1.12 → 0.38  ██░░░░          1.13 → 0.44  ██░░░░
base → final model                    2.10 → 0.38  ██░░░░░░░░░░    2.05 → 0.44  ██░░░░░░░░░░
   joint 1                            2.45 → 0.40  ██░░░░░░░░░░░░  2.38 → 0.45  ███░░░░░░░░░░░
   joint 2                            1.68 → 0.36  ██░░░░░░░░      1.65 → 0.42  ██░░░░░░░
█ what remains, ░ what was closed

Where the base model disagrees
  joint 1: at low speed, |dq| < 0.12 rad/s, mean residual ±0.80 N·m (sign of the velocity); 62 % of
    the gap goes with the velocity
  joint 1: just after a reversal, within 0.021 rad, mean residual +0.70 N·m; 41 % of the gap goes
    with the distance since the last reversal
  joint 1: at times from 4.0 to 5.0 s, mean residual -0.21 N·m; 4.0 % of the gap goes with the time
  joint 2: at low load, below 1.3 N·m, mean residual -0.041 N·m; 28 % of the gap goes with the load
  joint 2: at positions from -0.61 to 0.080 rad, mean residual +0.024 N·m; 11 % of the gap goes with
    the position

Windows of time with a torque of their own
  joint 2: 3.2 s to 3.45 s, 0.031 N·m (12 standard deviations), validation

Noise σ       joint 1 0.17 N·m, joint 2 0.0065 N·m (difference of 5 periods of 4.20 s)
Torque error  estimation 9.61 % → 4.40 %, validation 9.99 % → 4.73 %
Held-out RMS  0.46 to 0.53 of the base model's, 95 % interval
Time taken    41.7 s

Not accepted
  dead zone, joint 2: BIC difference 3.1 below 10
  torque ripple, joint 1: held-out RMS ratio 0.998, its interval reaches 1.004

Notes
  Clock of the log: shifted by 0.2 ms, accounted for.

Files
  robot description with the effects: robot_discovered.yaml
  plant with the effects, FMU: plant.fmu
"""


@pytest.mark.parametrize(
    ("conditions", "line"),
    [
        ([], ""),
        (["b is < 2"], "Provided that b is < 2."),
        (["b", "c is < 2", "d"], "Provided that b; and that c is < 2; and that 1 more hold (Notes)."),
    ],
)  # fmt: skip
def test_what_a_valid_discovery_rests_on_stands_below_its_verdict(
    conditions: list[str], line: str, tmp_path: Path
) -> None:
    result = document(conditions=conditions)
    text = discovery_table(result)
    assert " ".join(text[: text.index("Two-joint arm")].split()).endswith(f"0.44 times the noise. {line}".strip())
    page = page_of(saved(tmp_path, result))
    banner = page[page.index('<div class="banner good">') : page.index('<div class="cards">')]
    assert line.replace("<", "&lt;") in banner
    assert ("Provided that" in banner) == bool(line) == ("Provided that" in discovery_html(result))
    assert load_findings(tmp_path).conditions == conditions


def test_what_a_valid_discovery_excludes_stands_on_its_page(tmp_path: Path) -> None:
    stated = StatedResult(
        effect="offset", what="an offset of the torque", joint=1, place="joint 1", size=0.27, unit="% of the peak",
        largest=30.0, parameters={"tau0": 0.1},
        moves=MovedResult(size=0.27, parameter="MX1", deviations=32.0, percent=0.6),
    )  # fmt: skip
    power = PowerResult(power=0.95, stated=[stated], trusted=[])
    assert "MX1 by 32 sigma" in page_of(saved(tmp_path, document(power=power)))
    assert "an offset of the torque above 0.27 % of the peak" in " ".join(
        discovery_table(document(power=power)).split()
    )
    assert "an offset" not in discovery_table(document(power=power, verdict="doubtful"))


def test_text_is_this() -> None:
    assert discovery_table(document()) == GOLDEN


@pytest.mark.parametrize("answer", VERDICTS)
def test_text_and_page_begin_with_the_answer(tmp_path: Path, answer: str) -> None:
    grade, head, text = VERDICTS[answer]
    result = answered(answer)
    assert discovery_table(result).startswith(f"{head}: {text[0].upper()}{text[1:]}.")
    page = page_of(saved(tmp_path, result))
    assert f'<div class="banner {grade}"><b>{head}</b>' in page
    assert ("Findings</h2>" in page) == bool(result.findings)
    names = {series["name"] for series in charts(page)["torque-1"]["panels"][0]["series"]}
    assert names - {"measured"} == ({"base model", "final model"} if result.findings else {"base model"})


@pytest.mark.parametrize(("answer", "head"), [("nothing", "NOTHING FOUND"), ("named", "NAMED, WITH DOUBTS")])
def test_a_doubtful_answer_is_never_called_good(tmp_path: Path, answer: str, head: str) -> None:
    reason = DiagnosticResult(
        code="worse-on-held-out", place="validation: joint 1", text="The torque error is twice that of the fit.",
        value=2.0, bound=1.25, unit="1", next_step="Run fmu-didim discover case.yaml.",
    )  # fmt: skip
    result = answered(answer, verdict="doubtful", reasons=[reason])
    text = discovery_table(result)
    assert text.startswith(f"{head}: ")
    assert "1. validation: joint 1: The torque error is twice that of the fit. [worse-on-held-out]" in text
    page = page_of(saved(tmp_path, result))
    assert f'<div class="banner doubtful"><b>{head}</b>' in page
    assert "[worse-on-held-out]" in page


def test_unknown_says_where_and_a_remainder_on_which_joint() -> None:
    assert "Most of it: joint 1: at low speed, |dq| < 0.12 rad/s" in discovery_table(answered("unknown"))
    part = answered("named_with_remainder")
    left = part.gap["estimation"].model_copy(update={"after_per_joint": [0.4, 1.234]})
    text = discovery_table(part.model_copy(update={"gap": {**part.gap, "estimation": left}}))
    assert "is on joint 2: 1.23 times the noise" in " ".join(text.split())


@pytest.mark.parametrize("result", [document(), answered("unknown"), many(6), several()])
def test_text_stays_within_100_columns(result: FindingsDocument) -> None:
    long = result.model_copy(update={"notes": ["word " * 60], "name": "A long name " * 20})
    assert max(len(line) for line in discovery_table(long).splitlines()) <= 100


def test_of_several_experiments_each_has_its_gap_and_the_worst_is_told() -> None:
    text = discovery_table(several())
    words = " ".join(text.split())
    assert "The gap on the held-out data that fit worst, again, falls from 2.05 to 0.94 times the noise." in words
    assert "is on joint 2: 1.25 times the noise in the experiment with a payload of 5 kg at the wrist." in words
    heads = [line.split("noise", 1)[1].split() for line in text.splitlines() if line.startswith("Gap, in times")]
    assert heads == [["slow", "with", "a", "payload", "of", "5", "kg", "at", "…"], ["fast", "again"]]
    rows = [line for line in text.splitlines() if line.startswith("base → final model")]
    assert [re.findall(r"\d\.\d\d → \d\.\d\d", row) for row in rows] == [["2.10 → 0.38", "2.05 → 0.94"]] * 2


def test_files_are_told_with_their_experiment(tmp_path: Path) -> None:
    text = discovery_table(load_findings(saved(tmp_path, document(), count=50)))
    assert "torques, estimation: torque_estimation.csv" in text
    assert "torques, validation: torque_validation.csv" in text


def test_page_holds_each_finding_with_its_numbers_and_no_network(tmp_path: Path) -> None:
    result = document()
    page = page_of(saved(tmp_path, result))
    for finding in result.findings:
        for text in (f"{finding.title}, joint {finding.joint}", finding.equation, finding.experiment):
            assert text in page
        assert all(parameter.name in page for parameter in finding.parameters)
        assert all(rival.title in page for rival in finding.ambiguous)
    for number in ("0.812", "0.034", "0.746", "0.879", "0.00422", "0.00031", "2.10 → 1.12", "0.63 to 0.70", "BIC 4.2"):
        assert number in page
    assert not re.search(r"<(script|link|img|iframe)[^>]*\b(src|href)=", page)
    assert not re.search(r"https?://|@import|url\(", page)
    assert set(re.findall(r'href="([^#"]+)"', page)) == {
        "./robot_discovered.yaml", "./plant.fmu", "./torque_estimation.csv", "./torque_validation.csv"
    }  # fmt: skip
    assert "<code>ZZ1R = ZZ1 + Ia1</code>" in page


def test_bars_show_the_saved_gap(tmp_path: Path) -> None:
    names, estimation, validation, *_ = gap_table(document()).columns
    assert [name.strip() for name in names.texts[2:]] == ["base → final model", "joint 1", "joint 2"]
    assert estimation.texts[2:] == ["2.10 → 0.38", "2.45 → 0.40", "1.68 → 0.36"]
    assert validation.texts[2:] == ["2.05 → 0.44", "2.38 → 0.45", "1.65 → 0.42"]
    lengths = [(bar.former, bar.length) for bar in estimation.bars[2:] if bar is not None]
    assert [tuple(round(v, 1) for v in pair) for pair in lengths] == [(85.8, 15.7), (100.0, 16.4), (68.7, 14.9)]
    page = page_of(saved(tmp_path, document(), count=300))
    assert page.count('<i class="base"') == page.count('<i class="final"') == 2 * len(names.texts)
    assert '<i class="final" style="width:15.7%"></i><i class="base" style="width:70.2%"></i>' in page


def test_charts_show_the_saved_torque_and_residual(tmp_path: Path) -> None:
    columns = motion(2, count=300, seed=0)
    chart = charts(page_of(saved(tmp_path, document(), count=300)))["torque-1"]
    for j, sigma in ((1, 0.1712), (2, 0.00651)):
        torque, residual = 2 * j - 2, 2 * j - 1
        for name, column in (("measured", "measured"), ("base model", "base"), ("final model", "final")):
            time, drawn = line(chart, torque, name)
            np.testing.assert_allclose(time, columns["t"], atol=1e-9)
            np.testing.assert_allclose(drawn, columns[f"{column}{j}"], atol=1e-4 * np.ptp(columns[f"{column}{j}"]))
        for name, column in (("base model", "base"), ("final model", "final")):
            expected = columns[f"measured{j}"] - columns[f"{column}{j}"]
            np.testing.assert_allclose(line(chart, residual, name)[1], expected, atol=1e-4 * np.ptp(expected))
        np.testing.assert_allclose(chart["panels"][residual]["range"], (-2 * sigma, 2 * sigma))


def test_torque_of_every_control_period_is_drawn_where_it_was_saved(tmp_path: Path) -> None:
    folder = saved(tmp_path, document(), count=300)
    time = np.arange(2400) / 800
    dense = {f"{model}{j}": np.sin(time + j) for model in ("base", "final") for j in (1, 2)}
    write_csv(trajectory(time, dense), folder / "dense.csv")
    found = load_findings(folder)
    save_findings(found.model_copy(update={"files": {**found.files, "simulated_estimation": "dense.csv"}}), folder)
    drawn, values = line(charts(page_of(folder))["torque-1"], 2, "final model")
    inside = time <= 2.99  # the log ends there
    np.testing.assert_allclose(drawn, time[inside], atol=1e-9)
    np.testing.assert_allclose(values, np.sin(time[inside] + 2), atol=1e-4)


def test_strongest_quantity_is_drawn_first(tmp_path: Path) -> None:
    drawn = [name for name in charts(page_of(saved(tmp_path, document()))) if name.startswith("binned")]
    assert drawn == ["binned-1-1-velocity", "binned-1-1-position", "binned-1-2-position", "binned-1-2-velocity"]
    by_torque = document(regions=[region(1, "torque", "N.m", -1, 1, 0.3, 0.7)])
    (tmp_path / "other").mkdir()
    drawn = list(charts(page_of(saved(tmp_path / "other", by_torque))))
    assert "binned-1-1-torque" in drawn


def test_competition_of_each_round_with_the_best_first(tmp_path: Path) -> None:
    tried = [
        {"round": 1, "effect": "backlash", "joint": 2, "outcome": "fitted", "delta_bic": 120.0, "share_of_gap": 0.2,
         "parameters": 2.0, "implausible": "", "accepted": False},
        {"round": 1, "effect": "stribeck", "joint": 1, "outcome": "fitted", "delta_bic": 412.3, "share_of_gap": 0.617,
         "parameters": 2.0, "implausible": "", "accepted": True},
        {"round": 2, "effect": "dead_zone", "joint": 2, "outcome": "left early", "delta_bic": 3.1},
    ]  # fmt: skip
    page = page_of(saved(tmp_path, document(candidates=tried), count=300))
    rows = re.findall(
        r"<tr[^>]*>(.*?)</tr>", page[page.index('id="competition"') : page.index("<h3>Not accepted")], re.S
    )
    texts = [re.findall(r"<t[dh][^>]*>\s*(.*?)\s*</t[dh]>", row) for row in rows]
    assert [row[:6] for row in texts if row[0] != "candidate"] == [
        ["stribeck, joint 1", "added", "412", "0", "2", "62 %"],
        ["backlash, joint 2", "fitted", "120", "292", "2", "20 %"],
        ["dead zone, joint 2", "left early", "3.10", "0", "–", "–"],
    ]
    assert "BIC difference 3.1 below 10" in " ".join(texts[-1])


def test_bins_hold_mean_and_standard_error() -> None:
    at = np.repeat([0.0, 1.0], 50)
    values = np.where(at > 0, 3.0, -1.0) + np.tile([0.5, -0.5], 50)
    centre, mean, error = binned(at, values, bins=2)
    np.testing.assert_allclose(centre, [0.0, 1.0])
    np.testing.assert_allclose(mean, [-1.0, 3.0])
    np.testing.assert_allclose(error, np.sqrt(50 * 0.25 / 49 / 50))
    assert binned(np.zeros(10), np.arange(10.0))[1] == pytest.approx([4.5])


@pytest.mark.parametrize(
    ("without", "present", "absent"),
    [
        (("q", "dq"), ("torque-1",), ("binned-1-1-velocity",)),
        (("q",), ("torque-1", "binned-1-2-velocity"), ("binned-1-2-position",)),
        (("final",), ("torque-1", "binned-1-1-velocity"), ()),
        (("measured",), (), ("torque-1", "binned-1-1-velocity")),
        (("base", "final"), (), ("torque-1",)),
    ],
)
def test_missing_columns_leave_their_figure_out(
    tmp_path: Path, without: tuple[str, ...], present: tuple[str, ...], absent: tuple[str, ...]
) -> None:
    drawn = charts(page_of(saved(tmp_path, document(), without=without)))
    assert all(name in drawn for name in present)
    assert not any(name in drawn for name in absent)


def test_without_tables_there_is_a_page_and_with_a_lost_one_an_error(tmp_path: Path) -> None:
    save_findings(document(), tmp_path)
    assert "Residual" not in re.findall(r"<h2[^>]*>(\w+)", page_of(tmp_path))
    save_findings(document(files={"signals_estimation": "lost.csv"}), tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        write_discovery_report(tmp_path)


def test_a_shape_that_was_held_has_no_interval() -> None:
    held = ValueFound(name="N", unit="1", value=5.0, std=0.0, interval=(5.0, 5.0))
    assert value_line(held) == "5, held at a screened value"
    assert not value_text(held).insignificant


def test_what_is_unknown_is_a_dash(tmp_path: Path) -> None:
    nan = float("nan")
    found = stribeck() | {
        "parameters": [{"name": "Fs1", "unit": "N.m", "value": 0.81, "std": nan, "interval": (nan, nan)}],
        "gap": {"estimation": pair(2.1, None, [(2.4, None), (1.6, nan)])},
        "ratio_interval": (nan, None), "share_of_gap": 0.0,
    }  # fmt: skip
    gap = {
        "estimation": pair(2.1, 0.4, [(2.4, 0.4), (1.6, 0.4)]),
        "validation": pair(2.0, float("inf"), [(2.4, nan), (1.6, nan)]),
    }
    result = document(findings=[found], gap=gap, ratio_interval=None)
    text = discovery_table(result)
    assert "(0.81 ± –) N·m, not bounded by the data" in text
    assert "2.10 → –" in text
    assert "The final model cannot be simulated on held-out data" in " ".join(text.split())
    page = page_of(saved(tmp_path, result))
    for shown in (text, re.sub(r"<script.*?</script>", "", page, flags=re.S)):
        assert not re.search(r"\b(nan|inf|None|NaN)\b", shown)
    *_, final, joint1, joint2 = gap_table(result).columns[2].texts
    assert (final, joint1, joint2) == ("2.00 → –", "2.40 → –", "1.60 → –")


@pytest.mark.parametrize("joints", [1, 6])
def test_any_number_of_joints(tmp_path: Path, joints: int) -> None:
    result = many(joints)
    lines = discovery_table(result).splitlines()
    assert sum(line.startswith("   joint ") for line in lines) == (joints if joints > 1 else 0)
    drawn = charts(page_of(saved(tmp_path, result, count=400)))
    assert len(drawn["torque-1"]["panels"]) == 2 * joints
    assert len(gap_table(result).columns[0].texts) == 2 + (joints if joints > 1 else 0)
    assert drawn[f"binned-1-{joints}-position"]["label"] == ("position (m)" if joints > 1 else "position (rad)")


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([("velocity", "rad/s", -0.1, 0.0, 0.4), ("velocity", "rad/s", 0.0, 0.1, -0.4)],
         "at low speed, |dq| < 0.10 rad/s, mean residual ±0.40 N·m (against the velocity)"),
        ([("velocity", "rad/s", -2.0, -1.0, -0.4), ("velocity", "rad/s", 1.0, 2.1, 0.4)],
         "at high speed, |dq| from 1.0 to 2.0 rad/s, mean residual ±0.40 N·m (sign of the velocity)"),
        ([("velocity", "rad/s", -2.0, -1.0, 0.4)],
         "moving backward, dq from -2.0 to -1.0 rad/s, mean residual +0.40 N·m"),
        ([("velocity", "rad/s", -0.1, 0.08, 0.4)], "at low speed, dq from -0.10 to 0.080 rad/s"),
        ([("distance since the last reversal", "rad", 0.1, 0.2, 0.4)], "0.10 to 0.20 rad after a reversal"),
        ([("load", "N.m", 8.0, 12.0, -0.4)], "at loads from 8.0 to 12 N·m, mean residual -0.40 N·m"),
        ([("time", "s", 0.0, 3.0, 0.4), ("time", "s", 3.0, 5.0, 0.3), ("time", "s", 5.0, 9.0, 0.05)],
         "at times from 0 to 5.0 s, mean residual +0.35 N·m"),
    ],
)  # fmt: skip
def test_regions_in_words(parts: list[tuple[str, str, float, float, float]], words: str) -> None:
    result = document(regions=[region(1, *part, 0.5) for part in parts])
    assert strongest_regions(result)[0].startswith(f"joint 1: {words}")
    assert len(strongest_regions(result)) == 1


def test_page_escapes_what_it_shows(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    found = stribeck() | {"title": evil, "equation": evil, "experiment": evil}
    result = document(name=evil, notes=[evil], findings=[found], provenance={evil: evil},
                      files={"robot": evil, "plant_fmu": "javascript:alert(2)"})  # fmt: skip
    page = page_of(saved(tmp_path, result))
    assert "alert(1)" in page
    assert evil not in page
    assert 'href="javascript' not in page


def test_only_files_beside_the_page_are_links(tmp_path: Path) -> None:
    files = {"robot": "/other/robot.yaml", "plant_fmu": "../plant.fmu", "reference_next": "C:/next.csv", "x": "a b.csv"}
    save_findings(document(files=files), tmp_path)
    page = page_of(tmp_path)
    assert all(name in page for name in files.values())
    assert re.findall(r'href="([^#"]+)"', page) == ["./a%20b.csv"]


@pytest.mark.gate
def test_long_signals_do_not_swell_the_page(tmp_path: Path) -> None:
    assert write_discovery_report(saved(tmp_path, document(), count=40_000)).stat().st_size < 2e6


def test_saved_findings_are_read_again(tmp_path: Path) -> None:
    save_findings(document(), tmp_path)
    assert load_findings(tmp_path) == document()
    with pytest.raises(InputError, match="no saved discovery"):
        write_discovery_report(tmp_path / "elsewhere")
