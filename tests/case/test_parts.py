"""Loops of any number of components, wired in the case: python-control and FMUs, with parameters of all identified."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case import load_case
from fmu_didim.cosim import simulate
from fmu_didim.data.signals import Variable, trajectory, write_csv
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from tests.awkward.build import by

RATE, LOGGED, NOISE = 200.0, 2, 0.01
KP, KD, KM, T, J, D = 20.0, 1.5, 0.8, 0.02, 0.05, 0.1
"""Gains of the controller, gain and lag of the motor, inertia and damping of the load: what the data have."""
PD = '''
import control

def pd():
    """u = kp (q_ref - q) - kd w, sampled at 200 Hz."""
    def output(t, x, u, params):
        return [params["kp"] * (u[0] - u[1]) - params["kd"] * u[2]]
    return control.nlsys(
        None, output, inputs=["q_ref", "q", "w"], outputs=["u"], dt=0.005, name="pd",
        params={"kp": 14.0, "kd": 1.5},
    )
'''


def motor() -> Block:
    """T dtau/dt = km u - tau."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p", 2)
    return Block(
        name="motor", inputs=(Variable("u", "V", "input"),), outputs=(Variable("tau", "N.m", "output"),),
        states=(Variable("torque", "N.m", "local"),),
        parameters=(Variable("km", "N.m/V", "parameter", KM), Variable("T", "s", "parameter", 0.03)),
        update=ca.Function("f", [x, u, p], [(p[0] * u - x) / p[1]]), output=ca.Function("h", [x, u, p], [x]),
        start=ca.Function("s", [u, p], [ca.SX(0)]), rate_bound=ca.Function("r", [x, p], [1 / p[1]]),
    )  # fmt: skip


def load() -> Block:
    """J dw/dt = tau - d w, dq/dt = w."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p", 2)
    return Block(
        name="load", inputs=(Variable("tau", "N.m", "input"),),
        outputs=(Variable("q", "rad", "output"), Variable("w", "rad/s", "output")),
        states=(Variable("angle", "rad", "local"), Variable("speed", "rad/s", "local")),
        parameters=(Variable("J", "kg.m2", "parameter", 0.07), Variable("d", "N.m.s/rad", "parameter", 0.15)),
        update=ca.Function("f", [x, u, p], [ca.vertcat(x[1], (u - p[1] * x[1]) / p[0])]),
        output=ca.Function("h", [x, u, p], [x]), start=ca.Function("s", [u, p], [ca.SX(2, 1)]),
        rate_bound=ca.Function("r", [x, p], [p[1] / p[0]]),
    )  # fmt: skip


def motion(seed: int, seconds: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(round(seconds * RATE) + 1) / RATE
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 4)
    parts = zip((0.8, 0.5, 0.3, 0.15), (0.4, 1.1, 2.3, 4.7), phase, strict=True)
    return time, np.asarray(sum(a * (np.sin(2 * np.pi * f * time + p) - np.sin(p)) for a, f, p in parts))


def torque_of(reference: np.ndarray) -> np.ndarray:
    """The motor torque at the ticks: sampled controller; the motor's torque is held over a tick for the load, its own
    equation and the load's solved exactly in between."""
    tau, q, w, found = 0.0, 0.0, 0.0, []
    h, decay, slow = 1 / RATE, np.exp(-1 / RATE / T), np.exp(-D / J / RATE)
    for wanted in reference:
        u = KP * (wanted - q) - KD * w
        found.append(tau)
        end = tau / D + (w - tau / D) * slow
        q += tau / D * h + (w - tau / D) * (1 - slow) * J / D
        w, tau = end, KM * u + (tau - KM * u) * decay
    return np.array(found)


def three_parts(folder: Path, *, tool: str = "") -> dict[str, Any]:
    """A case of python-control and two FMUs, in one mapping; the FMUs from another tool, if one is named."""
    (folder / "parts.py").write_text(PD, encoding="utf-8")
    sources = {}
    for block in (motor(), load()):
        made = build_fmu(block, directory=folder / block.name)
        sources[block.name] = str(by(tool, made) if tool else made)
    document: dict[str, Any] = {
        "schema": 1, "name": "three parts",
        "components": {
            "pd": {"kind": "control", "source": "parts.py:pd"},
            "motor": {"kind": "fmu", "source": sources["motor"]},
            "load": {"kind": "fmu", "source": sources["load"]},
        },
        "connections": {
            "pd.q_ref": "reference.q1", "pd.q": "load.q", "pd.w": "load.w", "motor.u": "pd.u", "load.tau": "motor.tau",
        },
        "plant": {"component": "load", "inputs": {"tau1": "tau"}, "outputs": {"q1": "q", "dq1": "w"}},
        "identify": {
            "J": {"of": "load", "minimum": 1e-3}, "d": {"of": "plant"},
            "T": {"of": "motor", "minimum": 1e-3, "maximum": 0.2}, "kp": {"of": "pd", "minimum": 1.0},
        },
        "estimator": {"kind": "clie"},
    }  # fmt: skip
    rng = np.random.default_rng(4)
    for label, seed in (("train", 1), ("validation", 2)):
        time, q = motion(seed)
        torque = torque_of(q)[::LOGGED]
        torque = torque + NOISE * np.sqrt(np.mean(torque**2)) * rng.normal(size=torque.size)
        write_csv(trajectory(time, {"q1": q}), folder / f"{label}_reference.csv")
        write_csv(trajectory(time[::LOGGED], {"tau1": torque}), folder / f"{label}.csv")
        document[label] = {"reference": {"file": f"{label}_reference.csv"}, "torque": {"file": f"{label}.csv"}}
    return document


@pytest.mark.slow
@pytest.mark.parametrize("tool", ["", pytest.param("Vendor 1.0", marks=pytest.mark.slow)])
def test_three_parts_are_identified(tmp_path: Path, tool: str) -> None:
    """A parameter of each FMU and a gain of the controller, started 30 to 50 % off."""
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(three_parts(tmp_path, tool=tool), sort_keys=False), encoding="utf-8")
    outcome = identify(path, out=tmp_path / "out")
    assert outcome.document.status == "converged"
    truth = {"J": J, "d": D, "T": T, "kp": KP}
    estimate = outcome.estimate
    assert set(estimate.names) == set(truth)
    for name, value, sigma in zip(estimate.names, estimate.value, estimate.standard_deviation, strict=True):
        assert abs(value - truth[name]) <= 3.5 * sigma
        assert sigma < 0.05 * truth[name]
    parts = outcome.document.loop["components"]
    assert parts["pd"]["source"] == "parts.py:pd"
    assert {name: part["kind"] for name, part in parts.items()} == {"pd": "control", "motor": "fmu", "load": "fmu"}


def test_the_loop_is_that_of_the_equations(tmp_path: Path) -> None:
    document = three_parts(tmp_path)
    for name, values in (("load", {"J": J, "d": D}), ("motor", {"T": T}), ("pd", {"kp": KP})):
        document["components"][name]["parameters"] = values
    case = load_case(document, folder=tmp_path)
    reference = case.reference("estimation")
    system = case.system("estimation", reference)
    assert system.order == ("pd", "motor", "load")
    assert system.step_size == 1 / RATE  # the only one that is sampled says so
    found = simulate(system, reference)
    wanted = torque_of(reference.column("q1"))
    np.testing.assert_allclose(found.inputs["load.tau1"], wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())


def test_sums_and_gains_of_connections(tmp_path: Path) -> None:
    document = three_parts(tmp_path)
    document["connections"] |= {"load.tau": "0.5 * motor.tau - -0.5 * motor.tau", "pd.w": "-2*load.w + 3 * load.w"}
    plain = load_case(three_parts(tmp_path), folder=tmp_path).model
    summed = load_case(document, folder=tmp_path).model
    np.testing.assert_allclose(summed.torque(summed.start), plain.torque(plain.start), rtol=0, atol=1e-12)


def test_inputs_that_nothing_feeds_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    document = three_parts(tmp_path)
    del document["connections"]["pd.w"]
    load_case(document, folder=tmp_path)
    assert "Nothing is connected to pd.w" in caplog.text


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no torque": ({"connections": {"load.tau": None}}, r"Nothing is connected to a torque[\s\S]*load.tau1"),
    "no such output": ({"connections": {"pd.w": "load.v"}}, r"no output named 'v'[\s\S]*load.v -> pd.w"),
    "no such component": ({"connections": {"pd.w": "lod.w"}}, r"no component named 'lod'[\s\S]*Did you mean 'load'"),
    "no such input": ({"connections": {"pd.v": "load.w"}}, r"no input named 'v'"),
    "no connection": ({"connections": {"pd.w": "load.w load.q2 *"}}, r"no output named|cannot be read"),
    "no sum": ({"connections": {"pd.w": "3 *"}}, r"cannot be read[\s\S]*connections.pd.w"),
    "no such plant": ({"plant": {"component": "arm"}}, r"must say which component[\s\S]*pd, motor, load"),
    "both forms": ({"controller": {"source": "pd.yaml"}}, r"give controller: or components:, not both"),
    "options of the plant": ({"plant": {"substeps": 4}}, r"beside components: the plant takes"),
    "no such owner": ({"identify": {"x": {"of": "brake"}}}, r"no part of the loop named 'brake'[\s\S]*motor"),
    "reserved": ({"components": {"reference": {"kind": "fmu", "source": "a.fmu"}}}, r"reference: take letters"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_wirings_are_refused(tmp_path: Path, name: str) -> None:
    changes, message = WRONG[name]
    document = three_parts(tmp_path)
    for key, change in changes.items():
        merged = {**document.get(key, {}), **change}
        document[key] = {k: v for k, v in merged.items() if v is not None}
    with pytest.raises(FmuDidimError, match=message):
        load_case(document, folder=tmp_path)
