"""Commands that pass their arguments on to another application, which is a plugin."""

from collections.abc import Callable
from typing import Annotated, Any

from cyclopts import App, Parameter

from resample import registry
from resample.command.flags import Target

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


def launcher(name: str, *command: str) -> Callable[..., Any]:
    """Function that imports an application on demand and runs it, or one of its commands."""

    def launch(*words: Words) -> Any:
        application = registry.load("apps", name)
        return application(
            (*command, *words),
            exit_on_error=False,
            print_error=False,
            result_action="return_value",
        )

    vars(launch)["now"] = name, *command
    return launch


def fetcher(package: str, example: str) -> Callable[..., None]:
    """Command that downloads the public data sets of a package."""

    def fetch(name: str | None = None, /, *, folder: Target = None) -> None:
        from resample.files.public import print_sets

        print_sets(package, name, folder)

    fetch.__doc__ = FETCH.format(package.replace("_", "-"), example)
    return fetch


def command_now(application: str, command: str) -> tuple[str, App]:
    """Names and parser of an application's command."""
    commands = registry.load("apps", application)
    names = [name for name in commands if not name.startswith("-")]
    if command not in names:
        raise ValueError(
            f"resample-{application} has no command {command!r}; it has {', '.join(names)}"
        )
    return f"{commands.name[0]} {command}", commands[command]
