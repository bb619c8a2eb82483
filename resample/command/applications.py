"""Commands that pass their arguments on to another application, a plugin."""

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

from cyclopts import App, Parameter

from resample import registry
from resample.calling import understood
from resample.command.flags import DemoOutput, OptionTopic, Target, about, marks_of
from resample.console import say

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

RETURNING: Mapping[str, Any] = {
    "exit_on_error": False,
    "print_error": False,
    "result_action": "return_value",
}
Words = Annotated[str, Parameter(show=False, allow_leading_hyphen=True)]
FETCH = """Download and verify a public data set and print its folder; without a name, list all.

    For example:

        {0} fetch
        {0} fetch {1}
        {0} fetch {1} --folder data

    Parameters
    ----------
    name
        Name of the data set; its licence is printed.
    folder
        Folder to keep it in. [default: the user's cache]
    """
DEMO_FOLDER = Path("demo")
VIEWED = ("points", "texture", "volume", "warp3d")  # applications to which `resample view` leads
DEMO = """{1}

    For example:

        {0} demo
        {0} demo -o pictures
        {0} demo --output pictures/demo
    """


def launcher(name: str) -> Callable[..., Any]:
    """Function that imports an application on demand and runs it."""

    def launch(*words: Words) -> Any:
        application = registry.load("apps", name)
        return application(words, **RETURNING)

    vars(launch)["now"] = name
    return launch


def fetcher(package: str, example: str) -> Callable[..., None]:
    """Command that downloads the public data sets of a package."""

    def fetch(name: str | None = None, /, *, folder: Target = None) -> None:
        from resample.files.public import print_sets

        print_sets(package, name, folder)

    fetch.__doc__ = FETCH.format(package.replace("_", "-"), example)
    return fetch


def demonstrator(app: App, purpose: str, commands: Mapping[str, str]) -> Callable[..., None]:
    """Command that runs other commands of an application, which write files to a folder.

    `commands`: by the name of the file that each writes.
    """

    def demo(*, output: DemoOutput = DEMO_FOLDER) -> None:
        from resample.samples.finding import expanded

        output.mkdir(parents=True, exist_ok=True)
        for name, line in commands.items():
            words = [*line.split(), "-o", str(output / name)]
            say(f"{app.name[0]} {' '.join(words)}")
            app(expanded(words), **RETURNING)
        sys.stdout.write(f"The pictures are in {output.resolve()}\n")

    demo.__doc__ = DEMO.format(app.name[0], purpose)
    return demo


def command_now(application: str, command: str) -> tuple[str, App]:
    """Names and parser of an application's command."""
    commands = registry.load("apps", application)
    names = [name for name in commands if not name.startswith("-")]
    if command not in names:
        raise ValueError(
            f"resample-{application} has no command {command!r}; it has {', '.join(names)}"
        )
    return f"{commands.name[0]} {command}", commands[command]


def check_added(app: App, words: Sequence[str], option: str, value: str) -> None:
    """Reject an option that a sample adds to a command line, unless it sets the look.

    It may also name a file of the sample's own folder, or another sample.
    """
    from resample.samples.finding import OWN_FOLDER, PREFIX

    _, apps, rest = app.parse_commands(words)
    command = apps[-1].default_command
    now = getattr(command, "now", None)
    if now is not None:
        return check_added(registry.load("apps", now), rest, option, value)
    called = [] if command is None else [command]
    if called and "words" in inspect.signature(called[0]).parameters:  # `resample view` passes on
        called = [registry.load("apps", name)["view"].default_command for name in VIEWED]
    named = option.removeprefix("--")
    known = [marks for one in called if named in (marks := marks_of(one))]
    topics = {about(marks[named], value) for marks in known} or {about(None, value)}
    is_own = topics == {OptionTopic.SOURCE} and value.startswith((OWN_FOLDER, PREFIX))
    if topics != {OptionTopic.APPEARANCE} and not is_own:
        raise ValueError(f"a sample adds {option}={value:.60}, which is not about the look")
    return None


def run(application: str, command: str, *names: str | Path, **options: Any) -> None:
    """Run a command.

    `application`, `command`: their names, such as `volume` and `animate`. `names`: its positional
    arguments. `options`: its options by name, with values as for `command.settings.chosen`; None:
    left out. Raises TypeError: the option is unknown; it says what to give instead. Raises
    ValueError, OSError: as for the command.
    """
    from resample.command.settings import Choices, as_on_a_command_line, chosen

    function = registry.load("apps", application)[command].default_command
    parameters = inspect.signature(function).parameters
    hints = get_type_hints(function)
    own = [name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY]
    classes = {name: hints[name] for name in own if isinstance(hints[name], type)}
    groups = [name for name, kind in classes.items() if issubclass(kind, Choices)]
    models = [hints[name] for name in groups]
    single = [name for name in own if name not in groups]
    known = [*single, *(field for model in models for field in model.model_fields)]
    given = {name: value for name, value in options.items() if value is not None}
    given = understood(command, given, known)
    if isinstance(given.get("size"), list | tuple):
        given["size"] = "{}x{}".format(*given["size"])
    plain = {name: given.pop(name) for name in single if name in given}
    plain = {
        name: value if isinstance(value, Path) else as_on_a_command_line(value)
        for name, value in plain.items()
    }
    function(*names, **plain, **dict(zip(groups, chosen(given, models), strict=True)))


def film(
    application: str, command: str, *names: str | Path, output: Any, **options: Any
) -> "NDArray[np.uint8] | None":
    """Run a command that films; without an output return the frames (N, H, W, 3)."""
    if output is not None:
        run(application, command, *names, output=Path(output), **options)
        return None
    import numpy as np
    from PIL import Image

    with TemporaryDirectory() as folder:
        run(application, command, *names, output=Path(folder) / "frames", **options)
        return np.stack(
            [np.asarray(Image.open(one)) for one in sorted(Path(folder).rglob("*.png"))]
        )
