"""Settings files: the options of a command as TOML, kept from one run and given to another.

Such a file may come from anywhere, so it says how a picture looks, and nothing else: what options
are about is in `resample.command.about`.
"""

import inspect
import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, NoReturn, get_args, get_type_hints

from cyclopts import App, ArgumentCollection, Parameter
from cyclopts.argument import Argument
from cyclopts.config import Dict
from pydantic import BaseModel, TypeAdapter

from resample import memory as memories
from resample.command.about import About, Marks, about, marks_of, model_in, name_of
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
LOG = logging.getLogger("resample")
OWN = ("settings", "settings-trusted", "save-settings")
Given = Annotated[
    Path | None,
    About.TRUST,
    under(SETTINGS),
    Parameter(
        help="How pictures look, from a file: .toml, or a PNG or EXR that was made so; the command "
        "line goes before it."
    ),
]
Trusted = Annotated[
    Path | None,
    About.TRUST,
    under(SETTINGS),
    Parameter(
        help="As --settings, of a .toml that you wrote yourself: it may also say what is read, "
        "written and used."
    ),
]
Saved = Annotated[
    Path | None,
    About.TRUST,
    under(SETTINGS),
    Parameter(help="Also write how the picture looks, but not what is read and written (.toml)."),
]
Memory = Annotated[str | None, About.RESOURCE, under(LIMITS), Parameter(help=MEMORY + ".")]
Limit = Annotated[
    str | None,
    About.TRUST,
    under(LIMITS),
    Parameter(
        help="How much files may hold: unpacked=8GiB,ratio=5000; of text, tree, depth, items, "
        "unpacked, ratio. Far above what honest files need."
    ),
]
Outside = Annotated[
    bool,
    About.TRUST,
    Switch,
    under(LIMITS),
    Parameter(help="Let files name others outside of their folder."),
]


def with_settings(app: App) -> None:
    """Give every command of an application that has options those that all of them have.

    `--settings`, `--settings-trusted` and `--save-settings`, and what raises limits: `--memory`,
    `--limit` and `--allow-outside`.
    """
    app.config = (partial(_take, app.name[0]),)
    for name in app:
        command = None if name.startswith("-") else app[name].default_command
        if command is not None and _has_options(command):
            app[name].default_command = _keeping(f"{app.name[0]} {name}", command)


def _has_options(command: Command) -> bool:
    """Whether a command has options besides what it writes.

    Its signature says so; to assemble all commands as they are parsed would take a tenth of a
    second, and one of them is asked for.
    """
    named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parts = inspect.signature(command).parameters.values()
    return any(part.kind in named and part.name != "output" for part in parts)


def options_of(command: App) -> dict[str, Argument]:
    """Options of a command by their names without hyphens; not what it is given without a name."""
    return _options(command.assemble_argument_collection())


def schema_of(name: str, command: App) -> dict[str, Any]:
    """JSON schema of a command's settings; `about` says which any file may hold: the `look`.

    Parameters
    ----------
    name
        Of the application and the command.
    command
        It.
    """
    properties: dict[str, Any] = {COMMAND: {"const": name}}
    assert command.default_command is not None
    marks = marks_of(command.default_command)
    for key, argument in options_of(command).items():
        mark = marks[key]
        if mark is About.TRUST:
            continue
        adapter: TypeAdapter[Any] = TypeAdapter(argument.field_info.annotation)
        described = adapter.json_schema()
        described["about"] = mark.value if isinstance(mark, About) else "look, or source"
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


def read_settings(
    path: Path,
    name: str,
    options: Mapping[str, Argument],
    marks: Marks,
    *,
    is_trusted: bool = False,
) -> Settings:
    """Options of a command that a file holds, of the right types.

    Those that are about something else than the look are left out, which is said.

    Parameters
    ----------
    path
        A .toml, or a picture that was made by these commands.
    name
        Of the application and the command.
    options, marks
        Of the command, by name.
    is_trusted
        The file's own words are taken about all but what files may do.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, of another command, or an option is unknown or of another type; or a picture
        is to be trusted.
    """
    is_picture = path.suffix.lower() in PICTURES
    if is_picture and is_trusted:
        raise ValueError(f"{path} is a picture; trust a .toml that you wrote yourself")
    text = settings_in(path) if is_picture else text_of(path)
    left_out: list[str] = []
    with naming(str(path)):
        content = toml_of(text)
        owner = content.pop(COMMAND, name)
        if owner != name:
            raise ValueError(f"these are settings of {owner!r:.60}; give some of {name!r}")
        for key, value in list(content.items()):
            _check_name(key, options)
            if not _may_say(about(marks.get(key), value), is_trusted=is_trusted):
                left_out.append(key)
                del content[key]
                continue
            _check(key, value, options)
    if left_out:
        LOG.warning("%s: %s", path, _left_out(left_out, is_picture=is_picture))
    return content


def look_of(settings: Settings, marks: Marks) -> Settings:
    """Those settings that say how a picture looks: what files keep."""
    return {key: value for key, value in settings.items() if _may_say(about(marks.get(key), value))}


def _may_say(subject: About | None, *, is_trusted: bool = False) -> bool:
    """Whether a file may hold an option about something."""
    if is_trusted:
        return subject is not None and subject is not About.TRUST
    return subject is About.LOOK


def _left_out(keys: list[str], *, is_picture: bool) -> str:
    """Words about options that a file must not say."""
    instead = "" if is_picture else ", or trust your own file by --settings-trusted"
    return (
        f"{', '.join(keys)} left out, as settings say how a picture looks, not what is read, "
        f"written, used or trusted; give that on the command line{instead}"
    )


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
    named = {key: options[key].tokens for key in OWN[:2] if key in options and options[key].tokens}
    if not named:
        return
    if len(named) > 1:
        raise ValueError("give one of --settings and --settings-trusted, not both")
    ((key, tokens),) = named.items()
    path = Path(tokens[-1].value)
    known = {key: option for key, option in options.items() if key not in OWN}
    assert app.default_command is not None
    content: Settings = read_settings(
        path,
        " ".join([application, *commands]),
        known,
        marks_of(app.default_command),
        is_trusted=key == "settings-trusted",
    )
    for one in reversed(commands):
        content = {one: content}
    Dict(content, source=str(path))(app, commands, given)


def _check_name(key: str, options: Mapping[str, Argument]) -> None:
    """Refuse an unknown option."""
    if key not in options:
        near = get_close_matches(key, options, n=1)
        hint = f"did you mean {near[0]}?" if near else "--help lists what there is"
        raise ValueError(f"there is no option {key!r:.60}; {hint}")


def _check(key: str, value: object, options: Mapping[str, Argument]) -> None:
    """Refuse a value of another type than the option's."""
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
        settings_trusted: Path | None = None,
        save_settings: Path | None = None,
        memory: str | None = None,
        limit: str | None = None,
        allow_outside: bool = False,
        **options: Any,
    ) -> Any:
        marks = marks_of(command)
        chosen = dict(_chosen(command, signature, options))
        text = as_toml(name, look_of(chosen, marks))
        with (
            memories.allowing(memory),
            at_most(chosen.get("threads")),
            raised(limit, allow_outside=allow_outside),
            stating(text),
        ):
            if save_settings is None:
                return command(*inputs, **options)
            check_targets(save_settings, settings or settings_trusted, options.get("output"))
            result = command(*inputs, **options)
        with replacing(save_settings) as temporary:
            temporary.write_bytes(text.encode())
        if read := [key for key in chosen if about(marks[key], chosen[key]) is About.SOURCE]:
            LOG.warning("%s: %s", save_settings, _unsaid(read))
        return result

    _sign(run, command, signature)
    return run


def _unsaid(keys: list[str]) -> str:
    """Words about options that the picture was made with, and that are not kept."""
    return f"{', '.join(keys)} not kept, as settings do not say what is read; give that again"


def _sign(run: Command, command: Command, signature: inspect.Signature) -> None:
    """Give a command the options of another, and those that all have."""
    hints = get_type_hints(command, include_extras=True)
    kinds = {name: _headed(kind) for name, kind in hints.items()}
    own: dict[str, tuple[Any, object]] = {
        "settings": (Given, None),
        "settings_trusted": (Trusted, None),
        "save_settings": (Saved, None),
    }
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
    model = model_in(kind)
    return () if model is None else model.model_fields


def _headed(kind: Any) -> Any:
    """Kind of an argument; what is of a model has its heading in the help."""
    model = model_in(kind)
    if model is not None and issubclass(model, Choices):
        return Annotated[kind, under(model.heading)]
    return kind


def _chosen(
    command: Command, signature: inspect.Signature, options: Settings
) -> Iterator[tuple[str, Any]]:
    """Options that differ from what the command does by itself, by name, as TOML has them."""
    hints = get_type_hints(command, include_extras=True)
    for name, value in options.items():
        default = signature.parameters[name].default
        values, usual, metadata = {name: value}, {name: default}, {name: get_args(hints[name])[1:]}
        if isinstance(value, BaseModel):  # what was given is set, also where others differ
            fields = type(value).model_fields
            values = {
                field: getattr(value, field) for field in fields if field in value.model_fields_set
            }
            usual = _usual(type(value), default)
            metadata = {field: tuple(info.metadata) for field, info in fields.items()}
        for field, chosen in values.items():
            if chosen is not None and chosen != usual.get(field):
                yield name_of(field, metadata[field]), chosen


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
