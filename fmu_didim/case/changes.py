"""Other entries for a case that was read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict


class CaseChanges(TypedDict, total=False):
    """The entries of a case that :meth:`~fmu_didim.case.Case.with_` changes; see the case document for each of them."""

    name: str
    description: str
    robot: str | None
    identify: Mapping[str, Any] | None
    plant: Mapping[str, Any]
    controller: Mapping[str, Any] | None
    components: Mapping[str, Any] | None
    connections: Mapping[str, str]
    system: Mapping[str, Any] | str | None
    loop: Mapping[str, Any]
    experiments: Mapping[str, Any]
    train: Mapping[str, Any] | None
    validation: Mapping[str, Any] | None
    estimator: Mapping[str, Any]
    torque_std: Sequence[float] | None
    joint_weights: str
    low_pass: Mapping[str, Any] | None


def merged(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a case with these changes.

    Mappings are merged with what is there, all else replaces it, and None takes an entry out. Start values, and a
    reference or an estimator of another kind, replace the former ones as a whole.
    """
    result = dict(content)
    for key, value in changes.items():
        old = result.get(key)
        if value is None:
            result.pop(key, None)
        elif isinstance(value, Mapping) and isinstance(old, Mapping) and not _is_another(key, old, value):
            result[key] = merged(old, value)
        else:
            result[key] = value
    return result


def _is_another(key: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Whether a mapping stands for another thing than the old one, whose entries mean nothing to it."""
    if key == "start":
        return True
    other_kind = "kind" in new and new["kind"] != old.get("kind")
    return key in ("reference", "estimator") and (other_kind or ("file" in new and "file" not in old))
