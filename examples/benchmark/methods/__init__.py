"""The methods by name, each a function from a case file to an answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from examples.benchmark.answer import Answer
from examples.benchmark.methods import friction_models, neural, ours, plain_bic, sparse

METHODS: Mapping[str, Callable[[Path], Answer]] = {
    "ours": ours.answer,
    "plain_bic": plain_bic.answer,
    "friction_models": friction_models.answer,
    "sindy": sparse.answer,
    "neural": neural.answer,
}
NEEDS = {"sindy": "pysindy"}
"""What a method needs beside the project."""
TITLES = {
    "ours": "this project",
    "plain_bic": "plain BIC",
    "friction_models": "best of six friction models",
    "sindy": "SINDy",
    "neural": "neural residual",
}
"""As tables call them."""
