"""Content of `run.json`; docs/reference/files.md describes each part."""

from typing import Any, TypedDict


class RunFacts(TypedDict, total=False):
    """Parts of `run.json`. A part that is absent was not written, or was not usable."""

    schema_version: int
    created: str
    imported: bool
    plan: dict[str, Any]
    scene: dict[str, Any]
    environment: dict[str, Any]
    cpu: dict[str, Any]
    state: dict[str, Any]
    warnings: list[str]
    frames: list[Any]
    devices: dict[str, dict[str, Any]]
    seconds: dict[str, Any]
    resumed: list[str]
    interrupted: bool
    merged: list[Any]
    base: str
    beside: dict[str, Any]
    written: dict[str, Any]
