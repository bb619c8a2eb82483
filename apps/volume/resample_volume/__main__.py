"""The `resample-volume` command as a process; `python -m resample_volume` is the same."""

from typing import NoReturn

from resample.command.stopping import start


def main() -> NoReturn:
    """Run the command line; signals stop it cleanly at any moment."""
    start("resample_volume.cli")


if __name__ == "__main__":
    main()
