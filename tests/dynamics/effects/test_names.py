"""Names of parameters: two effects of one joint have none in common, unless they mean the same."""

from __future__ import annotations

from itertools import combinations

import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.effects import EFFECTS, clashing_names, effect_catalogue, effect_name
from fmu_didim.dynamics.effects.coulomb import Coulomb

TOGETHER = {("joint_elasticity", "backlash")}
"""A gear with play is an elastic one: its stiffness and damping are those of the gear."""


def test_no_two_effects_of_the_catalogue_share_a_name() -> None:
    for (one, effect), (other, second) in combinations(EFFECTS.items(), 2):
        if (one, other) not in TOGETHER:
            assert not clashing_names(effect, second), (one, other)


class Again(Coulomb):
    """Coulomb friction under the names of that of the catalogue."""

    name = "again"
    title = "Coulomb friction again"


def test_an_effect_of_ones_own_with_the_names_of_another_is_refused() -> None:
    """Discovery would put two columns of one name beside each other."""
    with pytest.raises(InputError, match="the same name as 'coulomb'") as caught:
        effect_catalogue([effect_name(Again)])
    assert caught.value.got == "Fc"
