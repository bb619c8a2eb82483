"""Entry point of the `resample` command and of `python -m resample`."""

from typing import NoReturn

from resample.command.stopping import start


def main() -> NoReturn:
    """Run the command line; signals can stop it at any moment."""
    start("resample.cli")


if __name__ == "__main__":
    main()
