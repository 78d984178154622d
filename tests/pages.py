"""Runs the examples that pages tell of, and writes what they gave as files of figures.

    python -m tests.pages emps          # needs the data of the EMPS: FMU_DIDIM_DATA
    python -m tests.pages tx40          # minutes
    python -m tests.pages black_box
    python -m tests.pages scara
    python -m tests.pages double_pendulum   # minutes
    python -m tests.pages signatures
    python -m tests.pages estimators        # minutes

Each writes ``docs/figures/<name>.json`` (``--out`` names another file); ``python docs/include.py`` fills the pages.
"""

from __future__ import annotations

import argparse
import re
import runpy
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from fmu_didim import campaign, discover, identify
from fmu_didim.base.documents import load_yaml
from fmu_didim.case import load_case
from fmu_didim.components import ModelComponent
from fmu_didim.controllers import read_controller
from fmu_didim.estimators import Didim
from fmu_didim.fit.statistics import relative_deviation_percent
from fmu_didim.report.numbers import rounding
from fmu_didim.results.findings import FindingResult, FindingsDocument
from fmu_didim.workflow.output.result import Result
from tests.figures import FOLDER, command_of, table, write_figures
from tests.helpers import ROOT, with_component, with_torque

Figures = dict[str, str | list[str]]
EMPS, TX40, SCARA, PENDULUM = (ROOT / "examples" / name for name in ("emps", "tx40", "scara", "double_pendulum"))


def emps() -> Figures:
    """What the usual model of the EMPS lacks, its pulses, and what a sample of delay does to its mass."""
    found = [discover(EMPS / "discover.yaml", rounds=count) for count in (1, 2, 5)]
    last = found[-1]
    assert [f.effect for f in found[1].findings] == [f.effect for f in last.findings], "other effects with more rounds"
    rows = [("base", *(_percent(found[0], label, 0) for label in ("estimation", "validation")), "")]
    for document, finding in zip(found, last.findings, strict=False):
        errors = (_percent(document, label, 1) for label in ("estimation", "validation"))
        rows.append((f"+ {finding.title}", *errors, "{:.2f} to {:.2f}".format(*finding.ratio_interval or ())))
    second = last.findings[1]
    rivals = ", ".join(
        r.title + (f" (BIC {r.bic_behind:.0f} behind)" if r.bic_behind is not None else " (same class)")
        for r in second.ambiguous
    )
    refused = [f"* {effect.replace('_', ' ')}: {why}" for effect, _, why in last.refused]
    return {
        "models": table(("model", "estimation", "held-out", "held-out RMS ratio, 95 %"), rows),
        "second": second.title, "second_gain": f"{second.delta_bic:.0f}", "rivals": rivals, "refused": refused,
        **_pulses(), **_delay(),
    }  # fmt: skip


def _percent(document: FindingsDocument, label: str, which: int) -> str:
    value = document.error_percent[label][which]
    return f"{value:.2f} %" if value is not None else "–"


def _pulses() -> Figures:
    from tests.discovery.test_emps import PULSE, pulse_edges

    found = discover(EMPS / "discover_pulses.yaml")
    windows = [w for w in found.windows if w.experiment == "estimation"]
    begins, ends = pulse_edges()
    times, size = np.array([(w.begin_s, w.end_s) for w in windows]), np.array([w.torque for w in windows])
    count = min(len(windows), begins.size)
    # The last pulse outlasts the log.
    off = [np.abs(times[:count, 0] - begins[:count]).max(), np.abs(times[: ends.size, 1] - ends).max()]
    return {
        "pulses": f"{len(windows)} windows for {begins.size} pulses", "pulses_off": f"{1e3 * max(off):.1f} ms",
        "pulse_found": f"{size.mean():.1f} N", "pulse_true": f"{PULSE:.1f} N",
    }  # fmt: skip


def _delay() -> Figures:
    rows = runpy.run_path(str(EMPS / "loop_delay.py"))["rows"]()
    (_, none, *_), (_, whole, *_) = rows[0], rows[2]
    mass, deviation = none.value[0], none.standard_deviation[0]
    moved = abs(whole.value[0] - mass)
    return {"delay_mass": f"{moved:.2f} kg", "delay_mass_sigma": f"{moved / deviation:.1f}"}


def tx40() -> Figures:
    """One effect that the six joints of the TX40 hide, found among the whole catalogue."""
    hidden = runpy.run_path(str(TX40 / "make_data.py"))["HIDDEN"]
    rows, figures = [], {}
    for name in ("wrist", "load"):
        told: list[str] = []
        found = discover(TX40 / f"discover_{name}.yaml", progress=told.append)
        effect, joint, values = hidden[name]
        first, truth = found.findings[0], ", ".join(f"{v:g}" for v in values.values())
        others = ", ".join(r.title for r in first.ambiguous)
        shown = f"{first.title}, joint {first.joint}" + (f" (or {others})" if others else "")
        gaps = [f"{g.before:.2f} → {g.after:.2f}" for g in (found.gap["estimation"], found.gap["validation"])]
        rows.append((f"{effect.replace('_', ' ')}, joint {joint}", shown, _values(first), truth, *gaps))
        own = found.gap["estimation"]
        figures[f"{name}_joint"] = f"{own.before_per_joint[joint - 1]:.2f} → {own.after_per_joint[joint - 1]:.2f}"
        figures[f"{name}_count"] = str(len(found.findings))
        figures[f"{name}_off"] = " and ".join(
            f"{abs(p.value - true) / p.std:.1f}"
            for p, true in zip(first.parameters, values.values(), strict=True)
            if p.std
        )
        counts = [match[1] for line in told if (match := re.match(r"signatures of (\d+) candidates", line))]
        figures[f"{name}_candidates"] = counts[0]
    heads = ("hidden", "named", "found", "true", "gap, estimation", "gap, held-out")
    return {"table": table(heads, rows), **figures}


def _values(finding: FindingResult) -> str:
    texts = []
    for p in finding.parameters:
        digits = rounding(p.value, p.std or 0.0)
        texts.append(f"{digits.text(p.value)} ± {digits.deviation(p.std or 0.0)} {p.unit.removeprefix('1')}".strip())
    return ", ".join(texts)


def black_box() -> Figures:
    """Effects hidden in an FMU of the SCARA, named and put before it as components; and the same FMU without any."""
    from tests.discovery.vendor import vendor_case

    cases: Mapping[str, tuple[tuple[Any, ...], dict[str, float]]] = {
        "lag": (("actuator_lag", 1), {"T": 0.006}),
        "stribeck": (("stribeck", 2), {"Fs": 0.08, "vs": 0.15}),
        "none": ((), {}),
    }
    figures: Figures = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (where, values) in cases.items():
            (Path(folder) / name).mkdir()
            found = discover(vendor_case(Path(folder) / name, *where, **values))
            named = "; ".join(f"{f.title}, joint {f.joint}: {_values(f)}" for f in found.findings)
            figures[name] = named or found.answer
    return figures


def scara() -> Figures:
    """Data simulated with Table 1 of the paper as truth, identified from the starts of its three tables."""
    script = runpy.run_path(str(SCARA / "paper_tables.py"))
    names, figures = list(script["TRUTH"]), {}
    for number, (title, estimate) in enumerate(list(script["reproduce"]().items())[:3], 1):
        didim = estimate.stages["didim"]
        ours = relative_deviation_percent(didim.value, didim.standard_deviation)
        theirs, k = script["PAPER"][title][1], names.index("Fv1")
        figures |= {
            f"table{number}_iterations": str(estimate.iteration_count),
            f"table{number}_fv1": f"{ours[k]:.0f} %", f"table{number}_fv1_paper": f"{theirs[k]:.0f} %",
        }  # fmt: skip
    return {**figures, **_formulas()}


WEAK = {"Kp1": 150.0, "Kd1": 40.0, "Kp2": 3.0, "Kd2": 0.8}
"""Gains with which the SCARA follows its reference loosely."""


def _formulas() -> Figures:
    """The deviation by the paper's formula over the corrected one, with the gains of the example and with weak ones."""
    model = load_case(SCARA / "identify_200hz.yaml").model
    assert model is not None
    weak = ModelComponent(read_controller(ROOT / "controllers/scara_pd.yaml")).with_parameters(WEAK)
    figures: Figures = {}
    for name, loop in (("tight", model), ("loose", with_component(model, "controller", weak))):
        torque = loop.torque(model.start)
        noise = 0.05 * np.sqrt((torque**2).mean(axis=0)) * np.random.default_rng(0).normal(size=torque.shape)
        estimator = Didim(start="reference", tolerance=1e-6, finish=False, maximum_iterations=60)
        estimate = estimator.estimate(with_torque(loop, torque + noise))
        ratio = estimate.stages["didim"].formulas["paper"] / estimate.standard_deviation
        figures[f"formula_{name}"] = f"{ratio.min():.2f} to {ratio.max():.2f}"
    return figures


PUBLISHED = {"ZZ1R": 0.111, "MX1R": 0.349, "ZZ2": 0.0239, "MX2": 0.111}
"""Base parameters of the double pendulum as its makers published them, kg.m2 and kg.m: examples/double_pendulum."""


def double_pendulum() -> Figures:
    """A real robot of two joints: its parameters, and what its usual model lacks; and the picture of both."""
    result, found = identify(PENDULUM / "identify.yaml"), discover(PENDULUM / "discover.yaml")
    _picture(result, found, ROOT / "docs/static/double_pendulum.png")
    (first,) = found.findings
    (value,) = first.parameters
    low, high = value.interval or (np.nan, np.nan)
    errors = {
        label: f"{_percent(found, label, 0)} to {_percent(found, label, 1)}" for label in ("estimation", "validation")
    }
    (note,) = [note for note in found.notes if note.startswith(first.title)]
    size = re.search(r"effect at (\S+) \((\S+ to \S+)\)", note)
    ahead = re.search(r"BIC difference of (\d+)", note)
    assert size is not None and ahead is not None
    return {
        **{f"{name}_published": f"{value:.3g}" for name, value in PUBLISHED.items()},
        **{name: f"{result.parameters[name].value:.3f} ± {result.parameters[name].std:.3f}" for name in PUBLISHED},
        "effect": f"{first.title.lower()} on joint {first.joint}", "gain": f"{first.delta_bic:.0f}",
        "value": f"{value.value:.3f}", "interval": f"{low:.3f} to {high:.3f}", **errors,
        "ratio": "{:.2f} to {:.2f}".format(*first.ratio_interval or ()), "size": size[1], "size_interval": size[2],
        "rival": first.ambiguous[0].title.lower(), "ahead": ahead[1], "verdict": found.verdict.replace("_", " "),
    }  # fmt: skip


def _picture(result: Result, found: FindingsDocument, path: Path) -> None:
    """Measured and simulated torque that was held out, values beside published ones, and the gap of each model."""
    figure = plt.figure(figsize=(11, 4.2), layout="constrained")
    grid = figure.add_gridspec(2, 3, width_ratios=(2.4, 1, 1))
    held_out = result.validation("validation")
    shown = held_out.time <= held_out.time[0] + 8
    for j in range(2):
        axes = figure.add_subplot(grid[j, 0])
        axes.plot(held_out.time[shown], held_out.measured[shown, j], ".", color="0.45", ms=4, label="measured")
        axes.plot(held_out.time[shown], held_out.simulated[shown, j], color="C0", lw=1.2, label="simulated")
        axes.set_ylabel(f"joint {j + 1}, N·m")
    figure.axes[0].set_title("Motor torque at 50 Hz that was held out", fontsize=10)
    figure.axes[0].legend(fontsize=8, ncols=2, loc="upper left")
    figure.axes[1].set_xlabel("time, s")
    values = figure.add_subplot(grid[:, 1])
    for row, (name, published) in enumerate(PUBLISHED.items()):
        value = result.parameters[name]
        low, high = np.array(value.interval) / published
        values.plot([low, high], [row, row], color="C0", lw=2)
        values.plot(value.value / published, row, "o", color="C0")
    values.axvline(1, color="0.45", ls="--", lw=1)
    values.set_yticks(range(len(PUBLISHED)), PUBLISHED)
    values.invert_yaxis()
    values.set_xlabel("value and 95 % interval / published")
    values.set_title("Parameters", fontsize=10)
    gaps = figure.add_subplot(grid[:, 2])
    errors = np.array(
        [[float(_percent(found, label, k).split()[0]) for k in (0, 1)] for label in ("estimation", "validation")]
    )
    for k, name in enumerate(("usual model", f"+ {found.findings[0].title.lower()}")):
        bars = gaps.bar(np.arange(2) + 0.4 * (k - 0.5), errors[:, k], 0.38, color=("0.7", "C0")[k], label=name)
        gaps.bar_label(bars, fmt="%.2f", fontsize=8)
    gaps.set_xticks([0, 1], ["fitted", "held out"])
    gaps.set_ylabel("torque error, %")
    gaps.set_ylim(0, 1.35 * errors.max())
    gaps.legend(fontsize=8, loc="upper left")
    gaps.set_title("Discovery", fontsize=10)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def signatures() -> Figures:
    """How alike the signatures of torque effects and the true changes of a closed loop of two joints are."""
    from tests.discovery.screening import test_signatures as tested

    with tempfile.TemporaryDirectory() as folder:
        bench = tested.two_joints(Path(folder))
        wide = [
            tested.compared(bench, signature, amplitude)[0]
            for name in tested.ADDED for joint in (1, 2)
            if not (joint == 2 and name in tested.PAIRED)
            for signature in [tested.chosen(bench, name, joint)]
            for amplitude in signature.amplitudes
            if amplitude not in tested.UNMOVED.get((name, joint), ())
        ]  # fmt: skip
        sharp = {
            name: min(
                tested.compared(bench, signature, amplitude)[0]
                for signature in (tested.sharp(bench, name, joint) for joint in (1, 2))
                for amplitude in signature.amplitudes
            )
            for name in tested.SHARP
        }
    worst = min(sharp, key=lambda name: sharp[name])
    return {
        "count": str(len(wide)), "least": f"{min(wide):.3f}", "median": f"{np.median(wide):.5f}",
        "sharp": ", ".join(f"{name.replace('_', ' ')} {value:.2f}" for name, value in sharp.items()),
        "sharp_least": f"{sharp[worst]:.2f}",
    }  # fmt: skip


ESTIMATORS = "examples/campaigns/scara_estimators.yaml"
DRAWS = 40
"""[draws] Of noise, which make a share of 95 % known to 2 %, the eight values of a draw being correlated."""
HEADS = (
    "estimator", "valid", "doubtful", "intervals that hold", "largest bias", "σ of ZZ1R", "σ of ZZ2", "median seconds"
)  # fmt: skip


def estimators() -> Figures:
    """All estimators on the same logs of the SCARA: how well their values and deviations hold, and what they take."""
    path = ROOT / ESTIMATORS
    content = load_yaml(path) | {"seeds": DRAWS}
    with tempfile.TemporaryDirectory() as folder:
        results = campaign(content, folder, folder=path.parent).run(workers=1)
        groups, values = results.groups(), results.by_parameter()
    stated = values.pivot(index="label.estimator", columns="parameter", values="stated")
    lines = []
    for row in groups.to_dict("records"):
        name = row["label.estimator"]
        sigma = [f"{stated.loc[name, value]:.2g} kg.m2" for value in ("ZZ1R", "ZZ2")]
        shares = f"{100 * row['coverage']:.1f} %", f"{row['largest_bias_in_sigma']:.2f} σ"
        lines.append((name, str(row["valid"]), str(row["doubtful"]), *shares, *sigma, f"{row['seconds']:.2g}"))
    return {"table": table(HEADS, lines), "draws": str(DRAWS)}


COMMANDS: Mapping[str, Callable[[], Figures]] = {
    "emps": emps, "tx40": tx40, "black_box": black_box, "scara": scara, "signatures": signatures,
    "double_pendulum": double_pendulum, "estimators": estimators,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of them, and write its file."""
    parser = argparse.ArgumentParser(prog="python -m tests.pages", description="Figures of the examples on the pages")
    parser.add_argument("name", choices=COMMANDS)
    parser.add_argument("--out", type=Path, help="file to write (docs/figures/<name>.json)")
    options = parser.parse_args(arguments)
    write_figures(
        options.out or FOLDER / f"{options.name}.json", command_of("tests.pages", [options.name]),
        COMMANDS[options.name](),
    )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
