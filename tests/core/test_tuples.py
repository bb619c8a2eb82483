"""Tuples on command lines: commas everywhere; what was written before is read as well."""

import re

import numpy as np
import pytest

from resample import registry
from resample.cameras.viewpoints import orbit_of, viewpoint_of
from resample.command.flags import ANGLES, OptionTopic, about
from resample.messages import choices_in, numbers_in
from resample_texture.command.choices import BetweenProjections
from resample_volume import Volume, load_transfer
from resample_volume.classification.transfer import spelled
from resample_volume.command.choices import AppearanceChoices
from resample_volume.command.inputs import _other
from resample_volume.files.texts import sizes_of, three_numbers
from resample_volume.meshes import ImagePlane, Section
from resample_volume.voxels.framing import planes

BALL = Volume(np.arange(64.0).reshape(4, 4, 4), np.ones(3), np.zeros(3), np.eye(3), "")
SLASHED = re.compile(r"(?<![\w./])-?[\d.]+(/-?[\d.]+)+(?![\w/])|\w+/\w+/\w+")


def seen(**options):
    """Look of a volume with these options, as text: arrays are not compared by ==."""
    return repr(AppearanceChoices(**options).appearance(BALL))


READ = {
    "camera": lambda text: orbit_of(text.format("30", "20", "1.5", "0.1", "-0.2")),
    "camera in Python": lambda text: viewpoint_of(text.format("30", "20", "1.5", "0.1", "-0.2")),
    "turn": lambda text: BetweenProjections(
        turn=text.format(30, 10, 5, "", "").strip("/,x ")
    ).angles(),
    "numbers": lambda text: numbers_in("move", text.format(0.1, 0, -2, 3, 4), 5),
    "slab": lambda text: Section.of(text.format(20, 10, 0, 0, 1)),
}


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("by", ["/", ", ", " "])
def test_a_tuple_has_commas_and_may_have_what_was_before(name, by):
    read = READ[name]
    assert read(by.join(["{}"] * 5)) == read(",".join(["{}"] * 5))


@pytest.mark.parametrize(
    ("option", "comma", "former"),
    [
        ("window", "40,60", "40/60"),
        ("light", "1,-1,2", "1/-1/2"),
        ("gradient_opacity", "0.1,0.5", "0.1/0.5"),
        ("transfer", "4,red,0 9,white,0.5", "4/red/0,9/white/0.5"),
        ("transfer", "hot:gradient=0.1,0.5,opacity=0.2", "hot:gradient=0.1/0.5,opacity=0.2"),
    ],
)
def test_looks_of_volumes_are_read_with_commas_and_slashes(option, comma, former):
    assert seen(**{option: comma}) == seen(**{option: former})
    assert seen(**{option: comma}) != seen()


def test_planes_are_read_with_commas_and_slashes():
    one, other = (planes(BALL, clip=(text,)) for text in ("1,0,-1,0.5", "1/0/-1/0.5"))
    assert np.array_equal(one, other)
    assert np.allclose(one[0, :3], [np.sqrt(0.5), 0, -np.sqrt(0.5)])
    plane = ImagePlane.of("1,0,-1,0.5:window=40,400,colors=viridis,opacity=0.5")
    assert plane.window == (-160.0, 240.0)
    assert (plane.colors, plane.opacity) == ("viridis", 0.5)
    assert plane.window == ImagePlane.of("z=1:window=40/400").window


def test_sizes_of_grids_and_voxels_are_read_with_commas_and_x():
    assert three_numbers("spacing", "1,1,1.4") == three_numbers("spacing", "1x1x1.4") == (1, 1, 1.4)
    assert sizes_of("256,256,128") == sizes_of("256X256x128") == (256, 256, 128)


def test_settings_of_further_volumes_may_be_tuples():
    name, source, look = _other(
        "pet.nrrd:window=5,10,spacing=1,1,2,time=3,transfer=hot:opacity=0.3"
    )
    assert name == "pet.nrrd"
    assert (source.spacing, source.time) == ("1,1,2", 3)
    assert look == {"window": "5,10", "transfer": "hot:opacity=0.3"}
    assert choices_in("a=1,2,b=,c") == [("a", "1,2"), ("b", ",c")]


def test_control_points_are_written_as_they_are_read():
    points = [(40.0, "#ff0000", 0.0), (90.0, "#ffffff", 0.5)]
    assert spelled(points) == "40,#ff0000,0 90,#ffffff,0.5"
    assert load_transfer(spelled(points)).opacity.tolist() == [0.0, 0.5]


@pytest.mark.parametrize("text", ["30,20,1.5", "30/20/1.5"])
def test_angles_in_settings_are_about_the_look(text):
    assert about(ANGLES, text) is OptionTopic.APPEARANCE


@pytest.mark.sweep
def test_no_help_shows_tuples_with_slashes():
    wrong = {}
    for application in registry.names("apps"):
        app = registry.load("apps", application)
        for command in (name for name in app if not name.startswith("-")):
            for argument in app[command].assemble_argument_collection():
                text = f"{argument.parameter.help} {argument.field_info.default}"
                text = re.sub(r"tcp://\S+|[\w.]+\.(zarr|jpg)|<.*", "", text)
                if argument.names and argument.names[0] != "*" and SLASHED.search(text):
                    wrong[argument.names[0]] = SLASHED.search(text)[0]
    assert wrong == {}
