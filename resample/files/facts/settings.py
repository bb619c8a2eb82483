"""Settings files: the options of a command as TOML, kept from one run and given to another."""

import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, NoReturn, get_args, get_origin, get_type_hints

from cyclopts import App, ArgumentCollection, Parameter
from cyclopts.argument import Argument
from cyclopts.config import Dict
from pydantic import BaseModel, TypeAdapter

from resample import memory as memories
from resample.command.flags import Switch, under
from resample.command.settings import LIMITS, MEMORY, SETTINGS, Choices
from resample.command.threads import at_most
from resample.files.facts.origin import SUFFIXES as PICTURES
from resample.files.facts.origin import settings_in, stating
from resample.files.writing import check_targets, replacing
from resample.reading.raising import raised
from resample.reading.texts import text_of, toml_of
from resample.words import naming

Command = Callable[..., Any]
Settings = dict[str, Any]

COMMAND = "command"  # the key that says whose settings they are
# What a run writes is its own: another run with its settings overwrites nothing.
TARGETS = {"output", "stats", "holes", "coverage", "depth-output", "export", "resume"}
# Of this run on this machine: a file that came from anywhere raises no limits.
LIMITING = ("limit", "allow-outside")
OWN = ("settings", "save-settings", *LIMITING)
Given = Annotated[
    Path | None,
    under(SETTINGS),
    Parameter(
        help="Options from a file: .toml, or a PNG or EXR that was made with them; those of the "
        "command line go before them."
    ),
]
Saved = Annotated[
    Path | None,
    under(SETTINGS),
    Parameter(help="Also write the options, but not what is read and written (.toml)."),
]
Memory = Annotated[str | None, under(LIMITS), Parameter(help=MEMORY + ".")]
Limit = Annotated[
    str | None,
    under(LIMITS),
    Parameter(
        help="How much files may hold: unpacked=8GiB,ratio=5000; of text, tree, depth, items, "
        "unpacked, ratio. Far above what honest files need."
    ),
]
Outside = Annotated[
    bool, Switch, under(LIMITS), Parameter(help="Let files name others outside of their folder.")
]


def with_settings(app: App) -> None:
    """Give every command of an application that has options those that all of them have.

    `--settings` and `--save-settings`, and what raises limits: `--memory`, `--limit` and
    `--allow-outside`.
    """
    app.config = (partial(_take, app.name[0]),)
    for name in app:
        command = None if name.startswith("-") else app[name].default_command
        if command is not None and _has_options(command):
            app[name].default_command = _keeping(f"{app.name[0]} {name}", command)


def _has_options(command: Command) -> bool:
    """Whether a command has options that settings may hold.

    Its signature says so; to assemble all commands as they are parsed would take a tenth of a
    second, and one of them is asked for.
    """
    named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parts = inspect.signature(command).parameters.values()
    return any(part.kind in named and part.name.replace("_", "-") not in TARGETS for part in parts)


def options_of(command: App) -> dict[str, Argument]:
    """Options of a command by their names without hyphens; not what it is given without a name."""
    return _options(command.assemble_argument_collection())


def schema_of(name: str, command: App) -> dict[str, Any]:
    """JSON schema of a command's settings.

    Parameters
    ----------
    name
        Of the application and the command.
    command
        It.
    """
    properties: dict[str, Any] = {COMMAND: {"const": name}}
    for key, argument in options_of(command).items():
        if key in OWN:
            continue
        adapter: TypeAdapter[Any] = TypeAdapter(argument.field_info.annotation)
        described = adapter.json_schema()
        default = argument.field_info.default
        if default not in (None, inspect.Parameter.empty):
            described["default"] = adapter.dump_python(default, mode="json")
        if argument.parameter.help:
            described["description"] = argument.parameter.help
        properties[key] = described
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": name,
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
    }


def read_settings(path: Path, name: str, options: Mapping[str, Argument]) -> Settings:
    """Options of a command that a file holds, of the right types.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, of another command, or an option is unknown or of another type.
    """
    text = settings_in(path) if path.suffix.lower() in PICTURES else text_of(path)
    with naming(str(path)):
        content = toml_of(text)
        owner = content.pop(COMMAND, name)
        if owner != name:
            raise ValueError(f"these are settings of {owner!r:.60}; give some of {name!r}")
        for key, value in content.items():
            _check(key, value, options)
    return content


def as_toml(name: str, settings: Settings) -> str:
    """Text of a settings file."""
    lines = [f"{key} = {_toml(value)}" for key, value in {COMMAND: name, **settings}.items()]
    return "\n".join(lines) + "\n"


def _options(arguments: ArgumentCollection) -> dict[str, Argument]:
    return {
        argument.names[0].removeprefix("--"): argument
        for argument in arguments
        if argument.names and argument.names[0].startswith("--")
    }


def _take(application: str, app: App, commands: tuple[str, ...], given: ArgumentCollection) -> None:
    """Fill what the command line leaves open from the file that `--settings` names, if any."""
    options = _options(given)
    tokens = options["settings"].tokens if "settings" in options else []
    if not tokens:
        return
    path = Path(tokens[-1].value)
    known = {key: option for key, option in options.items() if key not in OWN}
    content: Settings = read_settings(path, " ".join([application, *commands]), known)
    for command in reversed(commands):
        content = {command: content}
    Dict(content, source=str(path))(app, commands, given)


def _check(key: str, value: object, options: Mapping[str, Argument]) -> None:
    """Refuse an unknown option, and a value of another type than the option's."""
    if key not in options:
        near = get_close_matches(key, options, n=1)
        hint = f"did you mean {near[0]}?" if near else "--help lists what there is"
        raise ValueError(f"there is no option {key!r:.60}; {hint}")
    adapter: TypeAdapter[Any] = TypeAdapter(options[key].field_info.annotation)
    with naming(key):
        adapter.validate_json(json.dumps(value, default=_refuse_time), strict=True)


def _refuse_time(value: object) -> NoReturn:
    """Of what TOML has and JSON has not."""
    raise ValueError(f"no option is a date or a time (got {value})")


def _keeping(name: str, command: Command) -> Command:
    """Command that takes settings from a file and can leave its own, within limits."""
    signature = inspect.signature(command)

    @wraps(command)
    def run(
        *inputs: Any,
        settings: Path | None = None,
        save_settings: Path | None = None,
        memory: str | None = None,
        limit: str | None = None,
        allow_outside: bool = False,
        **options: Any,
    ) -> Any:
        chosen = dict(_chosen(signature, options))
        text = as_toml(name, chosen)
        with (
            memories.allowing(memory),
            at_most(chosen.get("threads")),
            raised(limit, allow_outside=allow_outside),
            stating(text),
        ):
            if save_settings is None:
                return command(*inputs, **options)
            check_targets(save_settings, settings, options.get("output"))
            result = command(*inputs, **options)
        with replacing(save_settings) as temporary:
            temporary.write_bytes(text.encode())
        return result

    _sign(run, command, signature)
    return run


def _sign(run: Command, command: Command, signature: inspect.Signature) -> None:
    """Give a command the options of another, and those that all have."""
    hints = get_type_hints(command, include_extras=True)
    kinds = {name: _headed(kind) for name, kind in hints.items()}
    own: dict[str, tuple[Any, object]] = {"settings": (Given, None), "save_settings": (Saved, None)}
    if not any("memory" in _fields_of(kind) for kind in hints.values()):
        own["memory"] = Memory, None
    own |= {"limit": (Limit, None), "allow_outside": (Outside, False)}
    run.__annotations__ = {**kinds, **{key: kind for key, (kind, _) in own.items()}}
    given = [part.replace(annotation=kinds[name]) for name, part in signature.parameters.items()]
    more = [
        inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=usual, annotation=kind)
        for key, (kind, usual) in own.items()
    ]
    vars(run)["__signature__"] = signature.replace(parameters=[*given, *more])


def _fields_of(kind: Any) -> Iterable[str]:
    """Options that a model in a signature stands for."""
    model = get_origin(kind) is Annotated and get_args(kind)[0]
    return model.model_fields if isinstance(model, type) and issubclass(model, Choices) else ()


def _headed(kind: Any) -> Any:
    """Kind of an argument; what is of a model has its heading in the help."""
    model = get_origin(kind) is Annotated and get_args(kind)[0]
    if isinstance(model, type) and issubclass(model, Choices):
        return Annotated[kind, under(model.heading)]
    return kind


def _chosen(signature: inspect.Signature, options: Settings) -> Iterator[tuple[str, Any]]:
    """Options that differ from what the command does by itself, by name, as TOML has them."""
    for name, value in options.items():
        default = signature.parameters[name].default
        values = {name: value}
        usual = {name: default}
        if isinstance(value, BaseModel):  # what was given is set, also where others differ
            given = [field for field in type(value).model_fields if field in value.model_fields_set]
            values = {field: getattr(value, field) for field in given}
            usual = _usual(type(value), default)
        for field, chosen in values.items():
            key = "json" if field == "as_json" else field.replace("_", "-")
            if key not in TARGETS and chosen is not None and chosen != usual.get(field):
                yield key, chosen


def _usual(model: type[BaseModel], default: object) -> Settings:
    """Values that fields have, whether others of the model are given or none is."""
    usual = {name: field.default for name, field in model.model_fields.items()}
    return {name: own for name, own in usual.items() if getattr(default, name, own) == own}


def _toml(value: object) -> str:
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower()
