"""The laws of the catalogue are the controllers of the package, sample by sample; responses are those to sines."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.controllers import LAWS as KINDS
from fmu_didim.workflow.naming.catalogue import (
    EXTRAS,
    LAWS,
    SPECIAL_OF,
    Candidate,
    Extra,
    JointSignals,
    candidates,
    simpler,
    takes,
)
from tests.helpers import component, drive

STEP, SAMPLES = 0.005, 60
VALUES = {
    "Kp": 30.0, "Ki": 90.0, "Kd": 2.0, "Kv": 9.0, "feedforward": 0.6, "Ka": 0.4, "filter_s": 0.008, "lag_s": 0.004,
    "limit": 45.0,
}  # fmt: skip
INSIDE: tuple[Extra, ...] = ("acceleration", "filter", "lag", "limit")
"""Extras that a description holds; a delay is of the loop."""


def signals() -> JointSignals:
    rng = np.random.default_rng(4)
    q_ref, dq_ref, ddq_ref, q, dq = rng.normal(size=(5, SAMPLES))
    return JointSignals(q_ref, dq_ref, ddq_ref, q, dq, STEP, np.arange(SAMPLES), np.zeros(SAMPLES))


def all_candidates() -> list[Candidate]:
    found = list(candidates())
    for candidate in candidates():
        found += [candidate.with_extra(extra) for extra in INSIDE if takes(candidate, extra)]
        every = candidate
        for extra in INSIDE:
            every = every.with_extra(extra) if takes(every, extra) else every
        found.append(every)
    return list(dict.fromkeys(found))


@pytest.mark.parametrize("candidate", all_candidates(), ids=lambda candidate: candidate.words)
def test_a_candidate_is_its_description(candidate: Candidate) -> None:
    values, s = {name: VALUES[name] for name in candidate.names}, signals()
    described = candidate.description([values], name="c", joints=["revolute"], rate_hz=1 / STEP, unit="N.m")
    block = KINDS[described["law"]].model_validate(described).block()
    table = {"q_ref1": s.q_ref, "dq_ref1": s.dq_ref, "ddq_ref1": s.ddq_ref, "q1": s.q, "dq1": s.dq}
    rows = np.column_stack([table[v.name] for v in block.inputs])
    expected = drive(component("model", block), rows, STEP)[:, 0]
    np.testing.assert_allclose(candidate.command(s, values), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("extra", [None, "filter", "lag", "delay"])
@pytest.mark.parametrize("base", candidates(), ids=lambda candidate: candidate.words)
def test_the_response_is_that_to_a_sine_of_the_position(base: Candidate, extra: Extra | None) -> None:
    if extra is not None and not takes(base, extra):
        return
    candidate = base if extra is None else base.with_extra(extra)
    values = {**{name: VALUES.get(name, 0.0) for name in candidate.names}, "delay": 2.3 * STEP}
    values = {name: values[name] for name in candidate.names}
    count, cycles = 4000, 90
    omega = 2 * np.pi * cycles / (count * STEP)
    time = np.arange(2 * count) * STEP
    zero = np.zeros(2 * count)
    rows = np.arange(2 * count)
    s = JointSignals(zero, zero, zero, np.sin(omega * time), omega * np.cos(omega * time), STEP, rows, zero)
    settled = candidate.command(s, values)[count:]
    found = 2 * np.abs(np.fft.rfft(settled)[cycles]) / count
    responses = candidate.responses(np.array([omega]), STEP, values) @ candidate.coefficients(values)
    assert found == pytest.approx(abs(responses[0]), rel=2e-3)


def test_a_simpler_law_gives_the_same_command_for_some_gains() -> None:
    """PD is a P-P cascade with whole feed-forward, with its lag."""
    cascade = next(c for c in candidates(["lag"]) if c.law.name == "P-P+ff" and c.rate == "measured")
    pd = next(c for c in simpler(cascade) if c.law.name == "PD")
    assert pd.extras == cascade.extras
    s = signals()
    of_cascade = cascade.command(s, {"Kv": 15.0, "Kp": 2.0, "feedforward": 1.0, "lag_s": 0.004})
    np.testing.assert_allclose(pd.command(s, {"Kp": 30.0, "Kd": 2.0, "lag_s": 0.004}), of_cascade, atol=1e-9)


def test_special_cases_are_of_laws_of_the_catalogue() -> None:
    names = {law.name for law in LAWS}
    assert set(SPECIAL_OF) == names
    assert set.union(*map(set, SPECIAL_OF.values())) <= names
    assert set(VALUES) | {"delay"} >= {parameter for parameter, _ in EXTRAS.values()}
