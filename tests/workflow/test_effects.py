"""The catalogue of effects as the command line shows it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.cli.main import main
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.report.drawing.plot import HEIGHT, WIDTH, text_plot
from fmu_didim.workflow.reference.effects import EffectEntry, effect_plot, effect_text, effects_text


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_is_explained(name: str) -> None:
    text, effect = effect_text(name), EFFECTS[name]
    flat = " ".join(text.split())
    for part in (effect.title, effect.equation, effect.signature, effect.experiment, *effect.confounded_with):
        assert " ".join(part.split()) in flat
    assert all(p.name in text for p in (*effect.own_parameters, *effect.own_shapes))
    assert max(map(len, text.splitlines())) <= 100


def test_list_has_all_by_place() -> None:
    text = effects_text()
    assert all(f"  {name} " in text for name in EFFECTS)
    assert text.index("drive:") < text.index("actuator_lag") < text.index("sensor:")


@pytest.mark.parametrize(
    ("name", "axis", "shape"),
    [
        # Friction, a spring and an inertia are functions of velocity, position and acceleration.
        ("coulomb", "velocity", np.tanh), ("spring", "position", None), ("motor_inertia", "acceleration", None),
    ],
)  # fmt: skip
def test_an_effect_is_drawn_over_what_it_depends_on(name: str, axis: str, shape: object) -> None:
    lines = effect_plot(EFFECTS[name])
    assert axis in lines[-1]
    rows = [line[11:] for line in lines[1 : HEIGHT + 1]]
    left = [i for i, row in enumerate(rows) if row.startswith("*")]
    right = [i for i, row in enumerate(rows) if len(row) == WIDTH and row.endswith("*")]
    assert min(left) > max(right)  # it rises


def test_plot_puts_points_where_they_are() -> None:
    x = np.linspace(0, 1, 7)
    lines = text_plot(x, {"*": 2 * x - 1}, x_name="x", y_name="y")
    assert lines[0] == "y"
    assert lines[1].startswith("        1 |") and lines[1].endswith("*")
    assert lines[HEIGHT] == "       -1 |*"
    assert lines[1 + HEIGHT // 2] == " " * 10 + "|" + "-" * (WIDTH // 2) + "*" + "-" * (WIDTH - WIDTH // 2 - 1)
    assert lines[-1].split() == ["0", "x", "1"]


def test_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects"]) == 0
    assert "Stribeck friction" in capsys.readouterr().out
    assert main(["effects", "stribeck", "--json"]) == 0
    assert EffectEntry.model_validate(json.loads(capsys.readouterr().out)).title == "Stribeck friction"
    assert main(["effects", "stribek"]) == 1
    assert "Did you mean 'stribeck'" in capsys.readouterr().err
    assert main(["schema", "effect"]) == 0
    assert "confounded_with" in json.loads(capsys.readouterr().out)["properties"]


def test_unknown_effect() -> None:
    with pytest.raises(UnknownNameError):
        effect_text("grease")


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert "identify" in text and "--time-limit" in text
