"""Records: identity, counters and times of each case; and the parts of `run.json`.

A case is one triangulation of a scene in one view, drawn by one rasteriser on one device.
`harness.results.parsing` reads records from JSON and writes them.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Literal, Self, TypedDict

from annotated_types import Ge, Interval

from harness.frame import View
from harness.rasterisers.base import Options

MAX_NUMBER = 2**63  # limit of a record's numbers, because readers compute with 64 bits

Number = Annotated[float, Interval(gt=-MAX_NUMBER, lt=MAX_NUMBER)]
Integer = Annotated[int, Interval(gt=-MAX_NUMBER, lt=MAX_NUMBER)]

Status = Literal["ok", "skipped", "failed", "counted"]  # "counted": not yet timed

Version = Literal["", "base"]  # of the code that triangulated: current, or of `run --beside`

NUMBER_MARK, UPRIGHT_MARK, HOST_MARK, BASE_MARK = "#", "@0", "@", "BASE "
_NAME = re.compile(r"(?P<base>.*?)(?:#(?P<number>\d+))?(?P<upright>@0)?", re.DOTALL)

_UNUSUAL = {  # field of a view or of options -> default value, text for another value
    "rotation": (0.0, "turned {:g}°"),
    "fit": ("box", "fit to a {}"),
    "samples": (1, "{} samples per pixel"),
    "work": (0, "work {}"),
    "texture": (0, "{} texture lookups"),
    "order": ("native", "{} order"),
    "seed": (0, "seed {}"),
}


def make_printable(text: object) -> str:
    """Return `text` as one line without control characters, for terminals and XML."""
    line = " ".join(str(text).split())
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in line)


def format_full_name(triangulator: str, number: int | None, *, upright: bool) -> str:
    """Return a triangulator's name with its number and mark, e.g. `random#7@0`."""
    suffix = "" if number is None else f"{NUMBER_MARK}{number}"
    return f"{triangulator}{suffix}{UPRIGHT_MARK if upright else ''}"


def split_name(name: str) -> tuple[str, int | None, bool]:
    """Return the parts of a name that `format_full_name` wrote: triangulator, number, upright."""
    match = _NAME.fullmatch(name)
    assert match is not None  # the pattern matches every text
    number = match["number"]
    return match["base"], None if number is None else int(number), match["upright"] is not None


@dataclass(frozen=True, order=True)
class CaseGroup:
    """Cases that differ in the triangulator alone; host is "" unless runs were merged."""

    scene: str
    rasteriser: str
    device: str
    host: str
    view: View
    options: Options

    @property
    def device_name(self) -> str:
        """The device's name, with the host if there is one: `gpu0@lab`."""
        return f"{self.device}{HOST_MARK}{self.host}" if self.host else self.device

    @property
    def condition(self) -> str:
        """View and options in short: `128 px, turned 30°, work 8`."""
        values = {**vars(self.view), **vars(self.options)}
        unusual = (
            text.format(values[name])
            for name, (default, text) in _UNUSUAL.items()
            if values[name] != default
        )
        return ", ".join([f"{self.view.resolution} px", *unusual])

    def __str__(self) -> str:
        """Return `city 1024 px, opengl on llvmpipe`."""
        device = f"{self.rasteriser} on {self.device_name}"
        return make_printable(f"{self.scene} {self.condition}, {device}")


@dataclass(frozen=True)
class CaseId:
    """Identity of a case. Cases that differ in the scene's content alone are equal."""

    scene: str
    view: View
    triangulator: str  # with its criterion, without number and marks
    rasteriser: str
    device: str
    options: Options
    number: Integer | None = None  # seed of `random`, position in `pareto` or `listed`
    upright: bool = False  # triangulated at rotation 0, then turned
    version: Version = ""
    host: str = ""
    scene_hash: str = field(default="", compare=False)  # "" if unknown; part of `key`

    @cached_property
    def group(self) -> CaseGroup:
        """The case without its triangulator."""
        fields = (self.scene, self.rasteriser, self.device, self.host)
        return CaseGroup(*fields, self.view, self.options)

    @cached_property
    def name(self) -> str:
        """The triangulator's full name: `random#7@0`, `BASE fan` of the other version."""
        mark = BASE_MARK if self.version else ""
        return mark + format_full_name(self.triangulator, self.number, upright=self.upright)

    @property
    def device_name(self) -> str:
        """The device's name, with the host if there is one."""
        return self.group.device_name

    @cached_property
    def key(self) -> str:
        """16 hexadecimal digits: a hash of the identity and of the scene's content."""
        content = {
            "scene": self.scene,
            "scene_hash": self.scene_hash,
            "view": asdict(self.view),
            "triangulator": self.name,
            "rasteriser": self.rasteriser,
            "device": self.device_name,
            "options": self.options.to_json(),
        }
        text = json.dumps(content, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def __str__(self) -> str:
        """Return `fan, city 1024 px, opengl on llvmpipe`."""
        return make_printable(f"{self.name}, {self.group}")

    def __lt__(self, other: Self) -> bool:
        return (self.group, self.name) < (other.group, other.name)


@dataclass(frozen=True)
class Time:
    """Times of one draw in s; sample r of each tuple is from round r."""

    timer: str = ""  # gpu, cpu or wall
    samples_s: tuple[Number, ...] = ()
    wall_s: tuple[Number, ...] = ()  # wall time, if `timer` is cpu
    waited_s: tuple[Number, ...] = ()  # time that threads waited for a core, if `timer` is cpu
    disturbed: Integer | None = None  # number of samples that `find_undisturbed` excludes
    stolen_s: Number | None = None  # core time that the host took, in all rounds
    others_s: Number | None = None  # CPU time of other processes, in all rounds
    timing_s: Number | None = None  # duration of all rounds
    median_s: Number | None = None  # of the undisturbed samples
    ci95_s: tuple[Number, Number] | None = None
    repeats: Integer | None = None  # draws in a batch; a sample is a batch's time per draw
    epochs: tuple[Annotated[Integer, Ge(1)], ...] = ()  # number of rounds in each
    processes: tuple[Integer, ...] = ()  # number of rounds in each
    precision: Number | None = None
    precision_reached: bool | None = None
    empty_s: tuple[Number, ...] = ()  # of an empty draw
    reference_s: tuple[Number, ...] = ()  # of the reference triangle
    round_group: str = ""  # cases with equal identifiers can be paired
    warnings: tuple[str, ...] = ()

    def is_paired_with(self, other: "Time") -> bool:
        """Return whether `other` was timed in the same rounds."""
        same = bool(self.round_group) and self.round_group == other.round_group
        return same and len(self.samples_s) == len(other.samples_s) > 0


@dataclass(frozen=True)
class LeastQuads:
    """Sums over the polygons whose minimum quad count is known."""

    polygons: Integer
    quads: Integer  # minimum
    shaded: Integer  # quads that the record's triangles of these polygons shade
    fragments: Integer  # pixels that these triangles cover


@dataclass(frozen=True)
class ViewCounters:
    """Sums of counters over each map tile or view (v,); names is () for map tiles."""

    counters: Mapping[str, tuple[Integer | Number, ...]]
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Record:
    """Result of a case (docs/reference/files.md); fields not measured are None or empty."""

    id: CaseId
    status: Status
    reason: str | None = None
    polygons: Integer = 0
    polygons_skipped: Integer = 0
    polygons_failed: Integer = 0
    vertices: Integer | None = None
    triangles: Integer | None = None
    predicted: Mapping[str, Number] = field(default_factory=dict)
    counters: Mapping[str, Integer] = field(default_factory=dict)
    triangulate_s: Number | None = None
    triangulate_samples_s: tuple[Number, ...] = ()
    polygons_cached: Integer = 0
    conforming: bool | None = None
    t_junctions: Integer | None = None
    proven: Integer | None = None
    largest_gap: Number | None = None
    coverage_error: Integer | None = None
    outline_quads: Integer | None = None
    least: LeastQuads | None = None
    views: ViewCounters | None = None
    time: Time | None = None
    key: str = ""  # names the record's arrays in its run folder

    def __post_init__(self) -> None:
        """Set `key` from the identity, unless the key was read from a file."""
        if not self.key:
            object.__setattr__(self, "key", self.id.key)

    @property
    def is_ok(self) -> bool:
        """Whether the case was measured."""
        return self.status == "ok"

    @property
    def name(self) -> str:
        """The triangulator's full name."""
        return self.id.name

    @property
    def all_polygons(self) -> int:
        """Polygons of the view, drawn or not."""
        return self.polygons + self.polygons_skipped + self.polygons_failed

    def with_id(self, **changes: Any) -> "Record":
        """Return the record with changed fields of `id`, and the same `key`, which names files."""
        return replace(self, id=replace(self.id, **changes))


class RunFacts(TypedDict, total=False):
    """Parts of `run.json` (docs/reference/files.md); a part is absent if missing or invalid."""

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
