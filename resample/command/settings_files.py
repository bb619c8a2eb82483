"""Settings files: options of a command, saved as TOML and read by later runs.

Such a file may come from anywhere, so it may only set the look of a picture. The categories of
options are in `resample.command.flags`.
"""

import inspect
import json
import logging
from collections.abc import Callable, Iterator, Mapping
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, NoReturn, get_args, get_type_hints

from cyclopts import App, ArgumentCollection, Parameter
from cyclopts.argument import Argument
from cyclopts.config import Dict
from pydantic import BaseModel, TypeAdapter

from resample import memory as memories
from resample.command.flags import (
    LIMITS,
    MEMORY,
    SETTINGS,
    Marks,
    OptionTopic,
    Switch,
    about,
    marks_of,
    model_in,
    name_of,
    under,
)
from resample.command.settings import Choices
from resample.command.stopping import at_most
from resample.files.metadata.provenance import SUFFIXES as PICTURES
from resample.files.metadata.provenance import settings_in, stating
from resample.files.writing import check_targets, replacing
from resample.messages import naming
from resample.reading.limits import raised
from resample.reading.texts import text_of, toml_of

Command = Callable[..., Any]
Settings = dict[str, Any]

COMMAND = "command"  # the key that names the command
LOG = logging.getLogger("resample")
OWN = ("settings", "settings-trusted", "save-settings")
Given = Annotated[
    Path | None,
    OptionTopic.TRUST,
    under(SETTINGS),
    Parameter(
        help="Read the look from a .toml, or from a PNG or EXR that this command made; options on "
        "the command line take precedence."
    ),
]
Trusted = Annotated[
    Path | None,
    OptionTopic.TRUST,
    under(SETTINGS),
    Parameter(
        help="Like --settings, for a .toml that you wrote yourself: it may also set inputs, "
        "outputs and resources."
    ),
]
Saved = Annotated[
    Path | None,
    OptionTopic.TRUST,
    under(SETTINGS),
    Parameter(help="Also write the look, without inputs and outputs (.toml)."),
]
Memory = Annotated[
    str | None,
    OptionTopic.RESOURCE,
    under(LIMITS),
    Parameter(help=f"{MEMORY}. [default: all free memory]"),
]
Limit = Annotated[
    str | None,
    OptionTopic.TRUST,
    under(LIMITS),
    Parameter(
        help="Limits on untrusted files: unpacked=8GiB,ratio=5000; of text, tree, depth, items, "
        "unpacked, ratio. [default: far above what ordinary files need]"
    ),
]
Outside = Annotated[
    bool,
    OptionTopic.TRUST,
    Switch,
    under(LIMITS),
    Parameter(help="Allow files to refer to files outside their folder."),
]


def with_settings(app: App) -> None:
    """Add the common options to every command of an application that has options.

    They are `--settings`, `--settings-trusted`, `--save-settings`, `--memory`, `--limit` and
    `--allow-outside`.
    """
    app.config = (partial(_take, app.name[0]),)
    for name in app:
        command = None if name.startswith("-") else app[name].default_command
        if command is not None and _has_options(command):
            app[name].default_command = keeping_settings(f"{app.name[0]} {name}", command)


def _has_options(command: Command) -> bool:
    """Whether a command has options besides its outputs.

    Decided by its signature: assembling all commands as the parser does takes 0.1 s, and only one
    of them runs.
    """
    named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    parts = inspect.signature(command).parameters.values()
    return any(part.kind in named and part.name != "output" for part in parts)


def options_of(command: App) -> dict[str, Argument]:
    """Options of a command by name without hyphens; positional arguments are left out."""
    return _options(command.assemble_argument_collection())


def schema_of(name: str, command: App) -> dict[str, Any]:
    """JSON schema of a command's settings; entries with `about` = `look` may be in any file."""
    properties: dict[str, Any] = {COMMAND: {"const": name}}
    assert command.default_command is not None
    marks = marks_of(command.default_command)
    for key, argument in options_of(command).items():
        mark = marks[key]
        if mark is OptionTopic.TRUST:
            continue
        adapter: TypeAdapter[Any] = TypeAdapter(argument.field_info.annotation)
        described = adapter.json_schema()
        described["about"] = mark.value if isinstance(mark, OptionTopic) else "look, or source"
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
    """Read options of a command from a file and convert their types.

    Options that are not about the look are left out with a warning.
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
            if key not in options:
                from resample.command.usage_errors import meant

                near = meant(key, options)
                hint = f"did you mean {near}?" if near else "--help lists what there is"
                raise ValueError(f"there is no option {key!r:.60}; {hint}")
            if not _may_say(about(marks.get(key), value), is_trusted=is_trusted):
                left_out.append(key)
                del content[key]
                continue
            adapter: TypeAdapter[Any] = TypeAdapter(options[key].field_info.annotation)
            with naming(key):
                adapter.validate_json(json.dumps(value, default=_refuse_time), strict=True)
    if left_out:
        instead = "" if is_picture else ", or trust your own file by --settings-trusted"
        why = "as settings only say how a picture looks, not what is read, written, used or trusted"
        remedy = f"give these on the command line{instead}"
        LOG.warning("%s: %s left out, %s; %s", path, ", ".join(left_out), why, remedy)
    return content


def appearance_settings(settings: Settings, marks: Marks) -> Settings:
    """Select the settings that affect the look: these are saved in files."""
    return {key: value for key, value in settings.items() if _may_say(about(marks.get(key), value))}


def _may_say(subject: OptionTopic | None, *, is_trusted: bool = False) -> bool:
    """Whether a file may set an option of this category."""
    if is_trusted:
        return subject is not None and subject is not OptionTopic.TRUST
    return subject is OptionTopic.APPEARANCE


def as_toml(name: str, settings: Settings) -> str:
    """Format settings as the text of a file."""
    lines = [f"{key} = {_toml(value)}" for key, value in {COMMAND: name, **settings}.items()]
    return "\n".join(lines) + "\n"


def _options(arguments: ArgumentCollection) -> dict[str, Argument]:
    return {
        argument.names[0].removeprefix("--"): argument
        for argument in arguments
        if argument.names and argument.names[0].startswith("--")
    }


def _take(
    application: str,
    app: App,
    commands: tuple[str, ...],
    given: ArgumentCollection,
) -> None:
    """Add options from the file given by `--settings` that the command line leaves open."""
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


def _refuse_time(value: object) -> NoReturn:
    """Reject a value that TOML has and JSON lacks."""
    raise ValueError(f"no option takes a date or time (got {value})")


def keeping_settings(name: str, command: Command) -> Command:
    """Wrap a command so that it reads and saves settings, within limits."""
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
        text = as_toml(name, appearance_settings(chosen, marks))
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
        if read := [key for key in chosen if about(marks[key], chosen[key]) is OptionTopic.SOURCE]:
            why = "not kept, as settings do not say what is read; give these again"
            LOG.warning("%s: %s %s", save_settings, ", ".join(read), why)
        return result

    _sign(run, command, signature)
    vars(run)["called"] = name  # of the program that has the command, whose package may be another
    return run


def _sign(run: Command, command: Command, signature: inspect.Signature) -> None:
    """Give a wrapper the options of its command and the common ones."""
    hints = get_type_hints(command, include_extras=True)
    kinds, models = dict(hints), {name: model_in(kind) for name, kind in hints.items()}
    for name, model in models.items():
        if model is not None and issubclass(model, Choices):
            kinds[name] = Annotated[hints[name], under(model.heading)]
    own: dict[str, tuple[Any, object]] = {
        "settings": (Given, None),
        "settings_trusted": (Trusted, None),
        "save_settings": (Saved, None),
    }
    if not any(model is not None and "memory" in model.model_fields for model in models.values()):
        own["memory"] = Memory, None
    own |= {"limit": (Limit, None), "allow_outside": (Outside, False)}
    run.__annotations__ = {**kinds, **{key: kind for key, (kind, _) in own.items()}}
    given = [part.replace(annotation=kinds[name]) for name, part in signature.parameters.items()]
    more = [
        inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=usual, annotation=kind)
        for key, (kind, usual) in own.items()
    ]
    vars(run)["__signature__"] = signature.replace(parameters=[*given, *more])


def _chosen(
    command: Command, signature: inspect.Signature, options: Settings
) -> Iterator[tuple[str, Any]]:
    """Options that differ from the command's defaults, by name, as TOML values."""
    hints = get_type_hints(command, include_extras=True)
    for name, value in options.items():
        default = signature.parameters[name].default
        values, usual, metadata = {name: value}, {name: default}, {name: get_args(hints[name])[1:]}
        if isinstance(value, BaseModel):  # given options, also if equal to the default
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
    """Defaults of a model's fields that a command's own default does not replace."""
    usual = {name: field.default for name, field in model.model_fields.items()}
    return {name: own for name, own in usual.items() if getattr(default, name, own) == own}


def _toml(value: object) -> str:
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    return str(value).lower()
