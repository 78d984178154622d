"""What every row of the table of estimators must be."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import pytest

from fmu_didim.base.docstrings import key_texts
from fmu_didim.estimators import ESTIMATORS


@pytest.mark.parametrize("name", ESTIMATORS)
def test_each_is_a_frozen_dataclass_whose_options_have_defaults_and_texts(name: str) -> None:
    form = ESTIMATORS[name]
    options = [field.name for field in fields(form)]  # type: ignore[arg-type]
    assert options
    made = form()
    with pytest.raises(FrozenInstanceError):
        setattr(made, options[0], None)
    assert made.describe() == {"name": name, **{option: getattr(made, option) for option in options}}
    texts = key_texts(form, options)
    assert [option for option in options if not texts.get(option)] == []
