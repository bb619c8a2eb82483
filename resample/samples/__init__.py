"""Built-in test data: pictures, depth images, meshes, clouds and volumes, generated on demand."""

from collections.abc import Sequence
from typing import NamedTuple


class DefaultOptions(NamedTuple):
    """Default options that a sample adds to a command."""

    commands: Sequence[str]  # commands that have these options
    words: Sequence[str]  # `FOLDER/` stands for the folder of the files
    unless: Sequence[str]  # prefixes of options that replace these


class SampleFiles(NamedTuple):
    """Files and options that replace a sample on a command line."""

    files: Sequence[str]  # names in the folder; the first represents all
    options: Sequence[DefaultOptions] = ()
