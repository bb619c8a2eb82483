"""The `resample` command: list plugins, compare pictures, start the applications."""

import errno
import json
import math
import sys
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, NoReturn

from cyclopts import App, Parameter

from resample import registry
from resample.command.applications import Words, command_now, launcher
from resample.command.help_formatter import CommandLine
from resample.command.session import run
from resample.lazy import installed_version

app = CommandLine(
    name="resample",
    help=(
        "Hybrid forward resampling: points where samples shrink, splats where they grow.\n\n"
        "For example:\n\n"
        "    resample view sample:room\n"
        "    resample compare sample:bricks --reference sample:test-card\n"
        "    resample plugins samples\n"
    ),
    version=installed_version,
)
app.register_install_completion_command()


@app.command
def plugins(group: str | None = None, /) -> None:
    """List all plugins with their parameters and defaults.

    For example:

        resample plugins
        resample plugins filters
        resample plugins samples

    Parameters
    ----------
    group
        One of apps, filters, orders, readers, reconstructions, samples. [default: all]
    """
    for name in registry.GROUPS if group is None else (group,):
        listed = "\n".join(map(partial(_plugin, name), registry.names(name)))
        sys.stdout.write(f"{name}\n{listed or '  none'}\n\n")


@app.command
def compare(
    *pictures: Path,
    reference: Annotated[Path, Parameter(alias="-R")],
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Measure pictures against a reference of the same size, as displayed over black.

    For example:

        resample compare sample:zone-plate --reference sample:test-card
        resample compare sample:bricks sample:zone-plate -R sample:test-card --json
        resample compare sample:bricks -R sample:test-card -o compare.png

    Parameters
    ----------
    pictures
        Files to measure.
    reference
        The picture to compare them with.
    output
        Also write all pictures side by side (.png).
    as_json
        Print JSON instead of a table; the PSNR of equal pictures is null.
    """
    from resample.measuring import compare as comparison
    from resample.memory import check_limits

    check_limits()

    if not pictures:
        raise ValueError("compare needs at least one picture besides the reference")
    rows, images = comparison.measure_files(pictures, reference)
    if output is not None:
        captions = {str(row["picture"]): f"PSNR {row['psnr']:.2f} dB" for row in rows}
        comparison.contact_sheet(images, output, captions=captions)
    if as_json:
        sys.stdout.write(
            json.dumps(
                [
                    ({key: None if value == math.inf else value for key, value in row.items()})
                    for row in rows
                ],
                indent=2,
            )
            + "\n"
        )
    elif sys.stdout.isatty():
        grid = comparison.table(rows)
        from rich.console import Console

        Console().print(grid)
    else:
        sys.stdout.write(comparison.plain(rows))


@app.command
def view(file: str, /, *words: Words) -> Any:
    """View a file, or a picture with its depth, in the browser.

    For example:

        resample view sample:vessel-tree
        resample view sample:room
        resample view sample:knot-points --no-browser

    Parameters
    ----------
    file
        The file to view.
    words
        A picture's depth, further files, and options of the `view` command of the application.
    """
    names = registry.names("views")
    files = [file, *takewhile(lambda word: not word.startswith("-"), words)]
    for name in names:
        if registry.load("views", name)(files):
            return launcher(name)("view", file, *words)
    if not Path(file).exists():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", file)
    raise ValueError(
        f"{', '.join(files)}: no application shows this; give a picture, a mesh, a volume, a point "
        "cloud, or a picture and its depth"
    )


@app.command
def schema(application: str, command: str, /) -> None:
    """Print the JSON schema of a command's settings files.

    For example:

        resample schema resample-volume render
        resample schema resample-texture warp
        resample schema resample-points animate

    Parameters
    ----------
    application
        Its command line, such as resample-volume.
    command
        One of its commands, such as render.
    """
    from resample.command.settings import schema_of

    written = schema_of(*command_now(application.removeprefix("resample-"), command))
    sys.stdout.write(json.dumps(written, indent=2, ensure_ascii=False) + "\n")


def main() -> NoReturn:
    """Run the command line of this process."""
    run(app)


def _plugin(group: str, name: str) -> str:
    """Describe a plugin: its package, summary and parameters, or why it cannot be used."""
    try:
        plugin = registry.load(group, name)
        summary = plugin.help if isinstance(plugin, App) else plugin.__doc__ or "no description"
        notes = [str(summary).strip().partition("\n")[0]]
        if group != "commands" and not isinstance(plugin, App):
            notes.append(registry.described(plugin))
    except LookupError as error:
        notes = [f"broken: {error}"]
    return "\n      ".join([f"  {name}  ({registry.distribution(group, name)})", *notes])


for _name in registry.names("apps"):
    _application = CommandLine(
        name=_name,
        help=f"Application of {registry.distribution('apps', _name)}; has its own --help.",
        help_flags=(),
        version_flags=(),
    )
    _application.default(launcher(_name))
    app.command(_application)
