"""Command lines with odd options and values, from the applications' own signatures."""

import os
import random
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, get_args

import numpy as np

from tests.fuzz.pool import Try

INPUTS = {  # what each command is given without a name
    "texture warp": ["a.png"], "texture resize": ["a.png", "o.png"],
    "texture scale": ["a.png", "o.png"], "texture rotate": ["a.png", "o.png"],
    "texture undistort": ["a.png", "o.png"], "texture rectify": ["a.png"],
    "texture mesh": ["a.obj"], "texture compare": ["a.png"], "texture animate": ["a.png"],
    "warp3d render": ["a.png", "d.npy"], "warp3d stereo": ["a.png", "d.npy"],
    "warp3d animate": ["a.png", "d.npy"], "points render": ["a.csv"],
    "volume render": ["v.npy"], "volume animate": ["v.npy"], "volume compare": ["v.npy"],
    "volume info": ["v.npy"], "volume convert": ["v.npy", "o.ome.zarr"],
}  # fmt: skip
NUMBERS = (
    "0 -1 1 2 nan inf -inf 1e308 1e-320 1e5 0x10 1_0 1,2 1,2,3 1,2,3,4,5,6 0,0,0,0,0,0,0,0,1 1..2 "
    "2..1 .. 30/20 30/20/1 0/0/0 nan/0/1 8 8x8 8x0 99999x99999 50% -5% 2GiB"
)
NAMES = (
    "none auto true red #ff0000 #ff box gaussian:sigma=0.6 gaussian:sigma=-1 a:b=c : = , "
    "rays:step=0 a.png d.npy v.npy gone.png empty.png . /dev/null folder o.png o.exr o.gif o.xyz "
    "no/o.png \x1b[2J ü \0 caf\udce9.png"
)
ODD_STREAMS = 0.1  # share of command lines
ODD = (*NUMBERS.split(" "), *NAMES.split(" "), "", " ", "9" * 40, "x" * 5000)
ENOUGH = ["--memory", "90MB"]  # of most commands the words are looked at, and no pictures painted


def write_inputs(folder: Path) -> None:
    """Write what the commands read."""
    from PIL import Image

    Image.fromarray(np.full((10, 12, 3), 90, np.uint8)).save(folder / "a.png")
    np.save(folder / "d.npy", np.full((10, 12), 2.0, np.float32))
    np.save(folder / "v.npy", np.arange(210, dtype=np.uint8).reshape(5, 6, 7))
    (folder / "a.csv").write_text("x,y,z\n0,0,1\n1,0,2\n0,1,3\n")
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    (folder / "empty.png").write_bytes(b"")
    (folder / "folder").mkdir()


def words_of(rng: random.Random, name: str, options: dict[str, Any]) -> list[str]:
    """Words of a command, some of whose options are odd."""
    application, command = name.split()
    words = [application, command, *INPUTS[name]]
    if rng.random() < 0.1:
        words[rng.randrange(2, len(words))] = rng.choice(ODD)
    for key in rng.sample(sorted(options), rng.randint(0, min(5, len(options)))):
        argument = options[key]
        kinds = [argument.hint, *get_args(argument.hint)]
        words.append(f"--{key}")
        known = argument.get_choices() or ()
        if bool not in kinds or rng.random() < 0.2:
            words.append(rng.choice(known) if known and rng.random() < 0.7 else rng.choice(ODD))
    if "output" in options and "--output" not in words and "o.png" not in words:
        words += ["-o", rng.choice(("o.png", "o.gif"))]
    return words


def _told_to_odd_streams(rng: random.Random, app: Any, words: list[str]) -> None:
    """Run a command whose output is full, goes to nobody, or is not there; it ends by itself."""
    from resample.command.session import run

    name = rng.choice(("stdout", "stderr"))
    kind = rng.choice(("full", "gone", "none"))
    before, stream = getattr(sys, name), None
    if kind == "full":
        stream = open("/dev/full", "w")  # noqa: SIM115 - closed below, which may fail
    elif kind == "gone":
        reader, writer = os.pipe()
        os.close(reader)
        stream = os.fdopen(writer, "w")
    setattr(sys, name, stream)
    try:
        run(app, words)
    except SystemExit as end:
        if end.code == 2:
            raise ValueError("status 2") from None
        if end.code != 0:
            raise RuntimeError(f"status {end.code} where {name} is {kind}") from None
    finally:
        setattr(sys, name, before)
        if stream is not None:
            with suppress(OSError):
                stream.close()


def make(*, is_quick: bool = False) -> Try:
    """Command line that a seed stands for; a quick one works on nothing large or compiled."""
    from cyclopts import CycloptsError

    from resample import registry
    from resample.command.settings import options_of

    apps = {name: registry.load("apps", name) for name in ("texture", "warp3d", "points", "volume")}
    known = {name: options_of(apps[name.split()[0]][name.split()[1]]) for name in INPUTS}

    def attempt(seed: int, folder: Path) -> None:
        rng = random.Random(seed)
        name = list(INPUTS)[seed % len(INPUTS)]
        words = words_of(rng, name, known[name])
        write_inputs(folder)
        os.chdir(folder)
        application, *rest = words
        more = ENOUGH if is_quick else []
        try:
            if rng.random() < ODD_STREAMS:
                _told_to_odd_streams(rng, apps[application], [*rest, *more])
                return
            apps[application](
                [*rest, *more], exit_on_error=False, print_error=False, result_action="return_value"
            )
        except CycloptsError as error:
            raise ValueError(str(error).replace("\n", " ")) from None
        finally:
            os.chdir("/")

    return attempt
