"""The `resample` command as a process; `python -m resample` is the same."""

from typing import NoReturn

from resample.command.stopping import start


def main() -> NoReturn:
    """Run the command line, which signals can stop at any moment."""
    start("resample.cli")


if __name__ == "__main__":
    main()
