"""A layout: which processes run on this host, and the options of each, from one TOML file.

extends = "local.toml"    # another layout beside it, whose tables this one changes
processes = ["frame_capture", ...]
[launch]            # robot, state_dir, log_level
[bus]               # frames
[links]             # certificates: how this host is linked with others
[shared]            # options for every process that has an option of that name
[frame_capture]     # one table a process, validated by that service's own Config
"""

import difflib
import importlib
import json
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from juncnet.links import ROUTER, is_loopback
from juncnet.messages import Name

C = TypeVar("C", bound=BaseModel)
SERVICES_PACKAGE = "juncnet_services"
OPTIONAL = ("dashboard", "recorder")
"""Processes that may be started beside those of any layout; it may have sections for them."""
SAVED = "layout.json"
"""The layout of a flight in its directory, as its processes were started with it."""


class LayoutError(ValueError):
    """A layout cannot be used; one line a problem, each naming file, section and option."""


class LaunchOptions(BaseModel):
    """Section `[launch]`: what all processes of the layout share."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Name = "robot"
    """Its name on the bus: keys are `juncnet/<robot>/...`."""
    state_dir: Path | None = None
    """Where what outlives a flight is kept; default `~/.local/state/juncnet/<robot>`."""
    log_level: Literal["debug", "info", "warning", "error"] = "info"


class BusOptions(BaseModel):
    """Section `[bus]`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    frames: Literal["auto", "iceoryx2", "zenoh"] = "auto"
    """How pictures travel on this host; auto: iceoryx2 where it is installed."""


class LinksOptions(BaseModel):
    """Section `[links]`: how this host is linked with others; a router has the same options."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vehicle: str | None = None
    """Address (`host:port`) of the vehicle's router, where the vehicle is another host."""
    video: str | None = None
    """Address of its link for video (`router.video_port`); None: the same link."""
    certificates: Path | None = None
    """Folder of this host's role, made by deploy/certificates; None: no links but plain ones.

    `--set links.certificates=` names none.
    """
    allow_anyone_on_the_network_to_fly_this_robot: bool = False
    """Listen or dial beyond this host without certificates."""

    @field_validator("certificates", mode="before")
    @classmethod
    def _none(cls, value: Any) -> Any:
        return None if value == "" else value

    @model_validator(mode="after")
    def _not_open_by_accident(self) -> Self:
        trusted = (
            self.certificates is not None or self.allow_anyone_on_the_network_to_fly_this_robot
        )
        if self.vehicle is not None and not trusted and not is_loopback(self.vehicle):
            raise ValueError(
                f"vehicle {self.vehicle} is on another host, and there are no certificates: whoever"
                " answers there could see and fly. Make certificates with deploy/certificates and"
                " name them in certificates"
            )
        return self


class Layout(BaseModel):
    """A layout as read; sections of services are validated by `section` or `validate_all`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    path: Path
    processes: tuple[str, ...] = Field(min_length=1)
    launch: LaunchOptions
    bus: BusOptions
    links: LinksOptions
    shared: dict[str, Any]
    """Options for every process that has an option of that name and does not set it itself."""
    sections: dict[str, dict[str, Any]]

    @property
    def state_dir(self) -> Path:
        """Where this robot's lasting state is kept."""
        default = Path.home() / ".local/state/juncnet" / self.launch.robot
        return (self.launch.state_dir or default).expanduser()

    def beside(self, *names: str) -> "Layout":
        """Return this layout with the optional processes called so."""
        all_of_them = tuple(dict.fromkeys((*self.processes, *names)))
        return self.model_copy(update={"processes": all_of_them})

    def save(self, path: Path) -> None:
        """Write the layout, its settings applied, as JSON that `load_layout` reads again."""
        fields = self.model_dump(mode="json", exclude={"path", "sections"})
        path.write_text(json.dumps(fields | self.sections, indent=2, default=str) + "\n")

    def section(self, service: str, config: type[C]) -> C:
        """Return the options of `service`.

        Raises:
            LayoutError: they do not fit `config`.
        """
        links = self.links.model_dump(exclude_unset=True) if service == ROUTER else {}
        offered = links | self.shared
        shared = {k: v for k, v in offered.items() if k in config.model_fields}
        own = self.sections.get(service, {})
        return _validated(self.path, service, config, _merged(shared, own))

    def validate_all(self) -> None:
        """Check every section against its service's Config.

        Raises:
            LayoutError: all problems, one a line.
        """
        problems: list[str] = []
        unused = set(self.shared)
        for service in self.processes:
            try:
                config = service_config(service)
                unused -= set(config.model_fields)
                self.section(service, config)
            except (LayoutError, ImportError) as error:
                problems.append(str(error))
        problems += [f"{self.path}: [shared] {name}: no process has it" for name in sorted(unused)]
        if problems:
            raise LayoutError("\n".join(problems))


def service_config(service: str) -> type[BaseModel]:
    """Return the Config of a service by its name."""
    module = importlib.import_module(f"{SERVICES_PACKAGE}.{service}.service")
    config: type[BaseModel] = module.Config
    return config


def load_layout(path: Path, settings: Sequence[str] = ()) -> Layout:
    """Return the layout in the file at `path`, changed by `section.key=value` settings.

    Raises:
        LayoutError: the file cannot be read, or has unknown sections or options.
    """
    tables = _tables(path)
    for setting in settings:
        _apply(tables, setting)
    processes = tables.pop("processes", [])
    known = ["launch", "bus", "links", "shared", *processes, *OPTIONAL]
    for name, table in tables.items():
        if name not in known:
            raise LayoutError(f"{path}: [{name}] is no process of this layout{_hint(name, known)}")
        if not isinstance(table, dict):
            raise LayoutError(f"{path}: {name} = ... must be a section [{name}]")
    launch = _validated(path, "launch", LaunchOptions, tables.pop("launch", {}))
    bus = _validated(path, "bus", BusOptions, tables.pop("bus", {}))
    links = _validated(path, "links", LinksOptions, tables.pop("links", {}))
    shared = tables.pop("shared", {})
    fields = {"path": path, "processes": processes, "launch": launch, "bus": bus, "links": links}
    return _validated(path, "", Layout, fields | {"shared": shared, "sections": tables})


def _tables(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text()
        tables: dict[str, Any] = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (OSError, ValueError) as error:
        raise LayoutError(f"{path}: {error}") from error
    base = tables.pop("extends", None)
    return tables if base is None else _merged(_tables(path.parent / str(base)), tables)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with `changes` laid over it, tables within tables too."""
    result = dict(base)
    for key, value in changes.items():
        if isinstance(result.get(key), dict) and isinstance(value, dict):
            value = _merged(result[key], cast("dict[str, Any]", value))
        result[key] = value
    return result


def _apply(tables: dict[str, Any], setting: str) -> None:
    match = re.fullmatch(r"([\w-]+(?:\.[\w-]+)+)=(.*)", setting, re.DOTALL)
    if match is None:
        raise LayoutError(f"--set {setting}: write section.option=value")
    *sections, option = match[1].split(".")
    table = tables
    for name in sections:
        table = table.setdefault(name, {})
    try:
        table[option] = tomllib.loads(f"value = {match[2]}")["value"]
    except tomllib.TOMLDecodeError:
        table[option] = match[2]


def _validated(path: Path, section: str, config: type[C], values: dict[str, Any]) -> C:
    try:
        return config.model_validate(values)
    except ValidationError as error:
        raise LayoutError("\n".join(_problems(path, section, config, error))) from error


def _problems(
    path: Path, section: str, config: type[BaseModel], error: ValidationError
) -> list[str]:
    lines: list[str] = []
    for problem in error.errors(include_url=False):
        option = ".".join(str(part) for part in problem["loc"])
        where = f"{path}: [{section}] {option}" if section else f"{path}: {option}"
        if problem["type"] == "extra_forbidden":
            known = list(config.model_fields)
            hint = _hint(option, known) or f" (there are: {', '.join(known) or 'none'})"
            lines.append(f"{where}: no such option{hint}")
        else:
            lines.append(f"{where}: {problem['msg']}, not {problem['input']!r:.60}")
    return lines


def _hint(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, known, 1, 0.5)
    return f": did you mean {close[0]!r}?" if close else ""
