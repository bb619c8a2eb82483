"""The `resample-points` command as a process; `python -m resample_points` is the same."""

from typing import NoReturn

from resample.command.stopping import start


def main() -> NoReturn:
    """Run the command line, which signals can stop at any moment."""
    start("resample_points.cli")


if __name__ == "__main__":
    main()
