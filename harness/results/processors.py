"""The processors on which stored runs were measured."""

from collections.abc import Iterable, Mapping
from typing import Any


def processor_label(facts: Mapping[str, Any]) -> str:
    """Return the processor of a run from the content of its `run.json`, or "" if unknown.

    Older runs have the processor's name alone.
    """
    processor, environment = (facts.get(name) for name in ("cpu", "environment"))
    label = processor.get("label") if isinstance(processor, Mapping) else None
    name = environment.get("cpu") if isinstance(environment, Mapping) else None
    return str(label or name or "")


def may_be_same(one: str, other: str) -> bool:
    """Return whether two labels may name one processor: one may be the start of the other."""
    return not one or not other or one.startswith(other) or other.startswith(one)


def list_different(labels: Iterable[str]) -> list[str]:
    """Return the labels of different processors, or [] if all may name one processor."""
    kinds: list[str] = []
    for label in sorted(set(labels), key=len, reverse=True):
        if not any(may_be_same(label, kind) for kind in kinds):
            kinds.append(label)
    return sorted(kinds) if len(kinds) > 1 else []
