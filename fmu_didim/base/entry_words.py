"""What is wrong with an entry of a document, in this package's own words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

KEY = "[key]"
"""Last part of pydantic's path of an entry whose key is wrong."""
LONGEST_MESSAGE = 4000
"""Characters of the message about an entry: our messages end with the advice, after the valid names."""
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")
_TEXT, _NUMBER, _WHOLE, _LIST, _KEYS = (
    "a text is needed here", "a number is needed here", "a whole number is needed here",
    "a list is needed here: [a, b]", "keys with values are needed here",
)  # fmt: skip
WORDS: Mapping[str, str] = {
    "json_invalid": "this is no valid JSON: {error}",
    "missing": "this key is required",
    "string_type": _TEXT,
    "float_type": _NUMBER,
    "float_parsing": _NUMBER,
    "int_type": _WHOLE,
    "int_parsing": _WHOLE,
    "int_from_float": _WHOLE,
    "int_parsing_size": "this number is too large",
    "finite_number": "a finite number is needed here",
    "bool_type": "true or false is needed here",
    "bool_parsing": "true or false is needed here",
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be {ge} or more",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be {le} or less",
    "literal_error": "must be one of {expected}",
    "enum": "must be one of {expected}",
    "too_short": "{actual_length} of {min_length} entries are given",
    "too_long": "at most {max_length} entries are taken",
    "string_too_short": "a text of {min_length} characters or more is needed here",
    "string_too_long": "a text of at most {max_length} characters is needed here",
    "string_pattern_mismatch": "does not have the form {pattern}",
    "list_type": _LIST,
    "tuple_type": _LIST,
    "set_type": _LIST,
    "frozen_set_type": _LIST,
    "iterable_type": _LIST,
    "dict_type": _KEYS,
    "mapping_type": _KEYS,
    "model_type": _KEYS,
    "model_attributes_type": _KEYS,
    "dataclass_type": _KEYS,
    "is_instance_of": "an object of the type {class} is needed here",
    "union_tag_not_found": "the key {discriminator} is required, which says of what kind this is",
    "union_tag_invalid": "{discriminator} must be one of {expected_tags}",
}
"""Type of an error of pydantic -> what we say."""


def in_words(detail: Mapping[str, Any]) -> str:
    """What is wrong with an entry, from a detail of a ValidationError; messages of our own validators stay."""
    if detail["type"] in ("value_error", "assertion_error"):
        told = str(detail["msg"])
        return told.removeprefix("Value error, ").removeprefix("Assertion failed, ")[:LONGEST_MESSAGE]
    if detail["loc"] and detail["loc"][-1] == KEY:
        if isinstance(detail["input"], int | float):
            return "a name is needed as key. Numbers have a decimal point: 3.43, not 3,43"
        if detail["type"] == "string_pattern_mismatch":
            return f"a key here has the form {detail['ctx']['pattern']}"
        return "a name is needed as key"
    words = WORDS.get(detail["type"], "this value does not fit here")
    told = words.format_map({name: _written(value) for name, value in detail.get("ctx", {}).items()})
    value = detail.get("input")
    if isinstance(value, str) and words in (_NUMBER, _WHOLE) and _DECIMAL_COMMA.fullmatch(value):
        return f"{told}, with a decimal point: {value.strip().replace(',', '.')}"
    return told[:LONGEST_MESSAGE]


def _written(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def details_of(error: ValidationError) -> list[Any]:
    """What pydantic found, without the values whose key is wrong itself."""
    details = error.errors(include_url=False)
    keys = {tuple(detail["loc"][:-1]) for detail in details if detail["loc"] and detail["loc"][-1] == KEY}
    return [detail for detail in details if tuple(detail["loc"]) not in keys]
