"""Scene names with parameters, such as "city:buildings=20" or "town.gpkg:layer=parks"."""

import difflib
import inspect
import json
import re
import sys
import types
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, Union, get_args, get_origin
from urllib.parse import unquote, urlsplit

from scenes.scene import SceneError


def format_suggestion(name: str, options: Iterable[str], prefix: str = "there are") -> str:
    """Return a hint for an error message: the nearest option, or all options after `prefix`.

    >>> format_suggestion("ctiy", ["city", "glyphs"])
    'did you mean city?'
    >>> format_suggestion("qqqqq", ["city", "glyphs"])
    'there are: city, glyphs'
    """
    choices = list(options)
    nearest = difflib.get_close_matches(name, choices, n=1)
    return f"did you mean {nearest[0]}?" if nearest else f"{prefix}: {', '.join(choices)}"


DISTRIBUTION = "raster-harness"  # name of this package in indexes

_FUNCTION = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")
_ENCLOSED = re.compile(r"""'[^']*'|"[^"]*"|\([^()'"]*\)""")


def format_install_command(extra: str) -> str:
    """Return the command that installs an optional extra, from where the package was installed.

    An index may lack the package, or have another package of this name.

    >>> "[tiles]" in format_install_command("tiles")
    True
    """
    python = Path(sys.executable)
    with suppress(ValueError):
        python = python.relative_to(Path.cwd())
    pip = f"{python} -m pip install"
    # The package may also be found as the egg-info of a checkout, without direct_url.json.
    records = [
        distribution.read_text("direct_url.json")
        for distribution in metadata.distributions(name=DISTRIBUTION)
    ]
    checkout = {"url": Path(__file__).parents[1].as_uri(), "dir_info": {"editable": True}}
    record: dict[str, Any] = json.loads(next(filter(None, records), "{}")) if records else checkout
    if "dir_info" in record:
        folder = unquote(urlsplit(record["url"]).path)
        return f'{pip} {"-e " * bool(record["dir_info"].get("editable"))}"{folder}[{extra}]"'
    source = f" @ {record['url']}" if record else ""
    if "vcs_info" in record:
        version = record["vcs_info"]
        source = f" @ {version['vcs']}+{record['url']}@{version['commit_id']}"
    return f'{pip} "{DISTRIBUTION}[{extra}]{source}"'


def import_optional(module: str, user: object, extra: str) -> Any:
    """Import a module for `user`, a file or option; raises SceneError with the install command."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        raise SceneError(
            f"{user}: {package} is not installed; {format_install_command(extra)}"
        ) from error


def parse_name(text: str) -> tuple[str, dict[str, str]]:
    """Split "name:key=value,key=value" into name and parameters; an existing path is not split.

    >>> parse_name("city:buildings=20,seed=3")
    ('city', {'buildings': '20', 'seed': '3'})
    """
    if path_exists(text):
        return text, {}
    match = re.fullmatch(r"(.+?):([A-Za-z_]\w*=.*)", text, flags=re.DOTALL)
    if not match:
        return text, {}
    # Commas within quotes or brackets are not separators.
    masked, previous = match[2], ""
    while masked != previous:
        previous, masked = masked, _ENCLOSED.sub(lambda match: "_" * len(match[0]), masked)
    commas = [match.start() for match in re.finditer(r",(?=[A-Za-z_]\w*=)", masked)]
    starts = [0, *(cut + 1 for cut in commas)]
    pairs = [match[2][a:b] for a, b in zip(starts, [*commas, None], strict=True)]
    return match[1], dict(pair.split("=", 1) for pair in pairs)


def is_function(name: str) -> bool:
    """Whether a name is "module:function" and not an existing path.

    >>> is_function("my.module:squares"), is_function("city"), is_function("town.gpkg")
    (True, False, False)
    """
    return _FUNCTION.fullmatch(name) is not None and not path_exists(name)


def is_path(name: str) -> bool:
    """Whether a name is a file: an existing path, or a name with a separator or suffix.

    >>> is_path("town.gpkg"), is_path("maps/town"), is_path("city"), is_path("my.module:squares")
    (True, True, False, False)
    """
    if path_exists(name):
        return True
    return not is_function(name) and ("/" in name or "\\" in name or Path(name).suffix != "")


def path_exists(name: str) -> bool:
    """Whether a file or folder of this name exists; False for a name that no path can have.

    >>> path_exists("."), path_exists("a\\0b"), path_exists(1000 * "long")
    (True, False, False)
    """
    try:
        return Path(name).exists()
    except (OSError, ValueError):  # too long for a path, or a NUL in it
        return False


def join_name(name: str, **parameters: Any) -> str:
    """Return a scene's name with parameters added; raises SceneError if it would be ambiguous.

    >>> join_name("town.gpkg:layer=parks", where="kind IN ('a', b=1)", limit=None)
    "town.gpkg:layer=parks,where=kind IN ('a', b=1)"
    """
    base, existing = parse_name(name)
    merged = {
        **existing,
        **{key: str(value) for key, value in parameters.items() if value is not None},
    }
    text = base + ":" * bool(merged) + ",".join(f"{key}={value}" for key, value in merged.items())
    if parse_name(text) != (base, merged):
        raise SceneError(f"{text} is ambiguous, because ',name=' begins a parameter: add brackets")
    return text


def format_label(text: str) -> str:
    """Return a scene's name as results show it: a file without its folder, for comparisons.

    >>> format_label("data/town.gpkg:where=height/2 > 3"), format_label("city:buildings=20")
    ('town.gpkg:where=height/2 > 3', 'city:buildings=20')
    """
    name, _ = parse_name(text)
    return Path(name).name + text[len(name) :] if is_path(name) else text


def convert_arguments(
    name: str, function: Callable[..., Any], parameters: dict[str, Any]
) -> dict[str, Any]:
    """Return parameters converted to the types that a builder declares; `name` is for messages.

    >>> def build(*, seed: int = 0, size: float = 1.0): ...
    >>> convert_arguments("grid", build, {"size": "2"})
    {'size': 2.0}
    """
    try:
        declared = inspect.signature(function, eval_str=True).parameters
    except NameError:  # a type is imported for type checkers only: no conversion
        declared = inspect.signature(function).parameters
    if any(p.kind is p.VAR_KEYWORD for p in declared.values()):
        return dict(parameters)
    options = [
        key
        for key, parameter in declared.items()
        if key != "seed"
        and (parameter.kind is parameter.KEYWORD_ONLY or parameter.default is not parameter.empty)
    ]
    for key in parameters:
        if key not in options:
            hint = format_suggestion(key, options, "it has") if options else "it has none"
            raise SceneError(f"scene {name} has no parameter {key!r}; {hint}")
    return {k: convert_value(k, v, declared[k].annotation) for k, v in parameters.items()}


def convert_value(key: str, value: Any, annotation: Any) -> Any:
    """Return a parameter's value, converted from text to the declared type.

    >>> convert_value("limit", "7", int | None), convert_value("project", "no", bool)
    (7, False)
    """
    is_union = get_origin(annotation) in (Union, types.UnionType)
    permitted = get_args(annotation) if is_union else (annotation,)
    if not isinstance(value, str) or inspect.Parameter.empty in permitted:
        return value
    for type_ in permitted:
        if type_ is bool and value.lower() in ("true", "yes", "1", "false", "no", "0"):
            return value.lower() in ("true", "yes", "1")
        if type_ in (int, float):
            try:
                return type_(value)
            except ValueError:
                continue
        if type_ is str:
            return value
    names = " or ".join(k.__name__ for k in permitted if k is not type(None))
    raise SceneError(f"parameter {key}={value!r} is not {names}: give a value like {key}=10")
