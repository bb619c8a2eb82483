"""Commands of other packages: entry points, imported when one of them is called."""

from copy import copy

from cyclopts import App
from cyclopts.command_spec import CommandSpec

from resample import registry
from resample.command.settings_files import keeping_settings


class AddedCommand(CommandSpec):
    """A command of another package, which help lists without a search for packages."""

    def resolve(self, parent_app: App) -> App:
        """Find the command's function, and add the options that all commands have.

        Raises LookupError: the package is not installed, or cannot be imported.
        """
        if self._resolved is None:
            function = registry.load("commands", self.import_path)
            owner = copy(parent_app)
            owner._commands = {}
            command = keeping_settings(f"{parent_app.name[0]} {self.name}", function)
            owner.command(command, name=self.name)
            self._resolved = owner[str(self.name)]
        return self._resolved


def add_command(app: App, entry: str, purpose: str) -> None:
    """Add a command by its entry point, such as `volume.compare`.

    `app`: what it is added to, after `with_settings`. `purpose`: what help says of it in a list.
    """
    name = entry.rpartition(".")[2]
    app._commands[name] = AddedCommand(entry, name, help=purpose)


def add_found(app: App, name: str) -> None:
    """Add a command that any package has for an application, if there is one of this name."""
    entry = f"{app.name[0].removeprefix('resample-')}.{name}"
    if entry in registry.names("commands"):
        add_command(app, entry, "")
