import numpy as np
import pytest
from pydantic import ValidationError

from resample.cameras.viewpoints import Orbit
from resample.command.settings import Resampling
from resample.painting.choices import MEASURING, Primitive, Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume.appearance import BY_DEFAULT, Appearance, Classification, XRay, check_together
from resample_volume.classification.labels import Rule
from resample_volume.classification.presets import LEVELS, load_transfer
from resample_volume.classification.transfer import spread
from resample_volume.command.choices import AppearanceChoices, ReadOptions
from resample_volume.command.inputs import opened
from resample_volume.files.generated import checker_box
from resample_volume.voxels.shading import DepthCue, Light

BOX = checker_box(4, 2)


def test_the_defaults_are_those_of_the_library():
    look = AppearanceChoices()
    assert look.appearance(BOX) == Appearance(load_transfer("checker"))
    assert look.viewpoint() == Orbit()


def test_every_choice_arrives():
    look = AppearanceChoices(
        transfer="gray",
        opacity_unit=2.5,
        camera="10/20/3",
        fov=50,
        up="-y",
        light="1/-1/2",
        gradient="sobel",
        gradient_opacity="0.1/0.5",
    )
    appearance = look.appearance(BOX)
    assert appearance.transfer.opacity_unit == 2.5
    assert appearance.light == Light((1, -1, 2))
    assert (appearance.gradient, appearance.gradient_opacity) == ("sobel", (0.1, 0.5))
    assert look.viewpoint() == Orbit(10, 20, 3, 50, "-y")


def test_auto_is_gray_levels_where_values_are_projected():
    for projection in MEASURING:
        resampler = Resampler(order=Rays(), projection=projection)
        transfer = AppearanceChoices().appearance(BOX, resampler).transfer
        # The means along the box's axes are all the same: they have no range of their own.
        span = (64.0, 192.0) if projection is Projection.AVERAGE else None
        assert transfer == (LEVELS if span is None else spread(LEVELS, span))
        named = AppearanceChoices(transfer="bone").appearance(BOX, resampler)
        assert named.transfer == load_transfer("bone")


def test_cuts_labels_and_depth_cues_arrive(tmp_path):
    labels = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    np.save(tmp_path / "labels.npy", labels)
    look = AppearanceChoices(
        labels=str(tmp_path / "labels.npy"),
        label=("1:hidden", "-0:color=red"),
        crop="1:,:,:",
        clip=("1/0/0", "0/-1/0/2"),
        depth_cue=0.25,
    )
    appearance = look.appearance(BOX)
    assert appearance.labels is not None
    assert appearance.labels.rules == {1: Rule(opacity=0), 0: Rule(color=(1, 0, 0))}
    assert (appearance.crop, appearance.clip) == ("1:,:,:", ("1/0/0", "0/-1/0/2"))
    assert appearance.cue == DepthCue(0.25)
    assert look.renderer(Resampling()) == BY_DEFAULT
    assert look.renderer(Resampling(method="points")) == Resampler(Primitive.POINTS)


def test_fields_are_gathered_along_rays_unless_an_order_is_chosen():
    post = AppearanceChoices(classify="post")
    assert post.renderer(Resampling()).order == Rays()
    maximum = Resampling(projection="maximum")
    assert AppearanceChoices().renderer(maximum).order == Rays(quality="usual")
    assert post.renderer(maximum).order == Rays()


@pytest.mark.parametrize(
    ("look", "resampling", "complaint"),
    [
        ({"label": ("1:hidden",)}, {}, "give the volume of labels, too"),
        ({"classify": "post"}, {"order": "every-sample"}, "needs the order rays, not"),
        ({"classify": "post"}, {"order": "image-sheets"}, "needs the order rays, not"),
        ({"depth_cue": 0.5}, {"projection": "average"}, "depth-cue dims light"),
        ({"gradient_opacity": "0/1"}, {"projection": "maximum"}, "gradient-opacity fades voxels"),
    ],
)
def test_what_does_not_go_together_is_refused_without_a_volume(look, resampling, complaint):
    with pytest.raises(ValueError, match=complaint):
        AppearanceChoices(**look).renderer(Resampling(**resampling))


@pytest.mark.parametrize("projection", list(Projection))
def test_options_of_other_projections_are_refused(projection):
    """Each is allowed for some, where it changes pixels."""
    only_composite = {Projection.COMPOSITE}
    suited = {
        "xray": {Projection.XRAY},
        "invert": set(MEASURING),
        "labels": only_composite,
        "gradient-opacity": only_composite,
        "depth-cue": set(Projection) - set(MEASURING),
    }
    iso = 1.0 if projection is Projection.FIRST_HIT else None
    resampler = Resampler(order=Rays(), projection=projection, iso=iso)
    for option, projections in suited.items():
        if projection in projections:
            check_together(resampler, Classification.POST, [option])
        else:
            with pytest.raises(ValueError, match=r"the projection ") as told:
                check_together(resampler, Classification.POST, [option])
            assert any(str(each) in str(told.value) for each in projections)


def test_light_is_chosen():
    look = AppearanceChoices(ambient=0.5, diffuse=0.25, specular=0, shininess=8, light="0/0/1")
    assert look.appearance(BOX).light == Light((0, 0, 1), 0.5, 0.25, 0.0, 8.0)


def test_a_window_spreads_fractions():
    appearance = AppearanceChoices(transfer="gray", window="40/400").appearance(BOX)
    assert appearance.transfer == spread(load_transfer("gray"), (-160.0, 240.0))
    for projection in MEASURING:
        resampler = Resampler(order=Rays(), projection=projection)
        made = AppearanceChoices(window="40/400").appearance(BOX, resampler)
        if projection is Projection.XRAY:
            assert made.xray == XRay(window=(-160.0, 240.0))  # of its line integrals
        else:
            assert made.transfer == spread(LEVELS, (-160.0, 240.0))


@pytest.mark.parametrize(
    ("window", "transfer", "complaint"),
    [
        ("40", "gray", "give a center and a width, 40,400, or a range"),
        ("40/0", "gray", "its width must be above 0, as in 40,400"),
        ("40/-3", "gray", "its width must be above 0"),
        ("nan/3", "gray", "its width must be above 0"),
        ("40/400", "engine", "the window applies to looks of fractions, but engine is in"),
        ("40/400", "skin", "skin is in Hounsfield units, which a window would rescale"),
    ],
)
def test_a_window_that_makes_no_sense_is_refused(window, transfer, complaint):
    with pytest.raises(ValueError, match=complaint):
        AppearanceChoices(window=window, transfer=transfer).appearance(BOX)


def test_without_shading_there_is_no_light():
    assert AppearanceChoices(shading=False).appearance(BOX).light is None
    assert AppearanceChoices(shading=False, light="1/0/0").appearance(BOX).light is None


@pytest.mark.parametrize(
    "choice",
    [
        {"opacity_unit": 0},
        {"opacity_unit": -1},
        {"opacity_unit": float("inf")},
        {"gradient": "steep"},
        {"up": "w"},
        {"colour": "red"},
    ],
)
def test_what_is_not_allowed_is_refused(choice):
    with pytest.raises(ValidationError, match=next(iter(choice))):
        AppearanceChoices(**choice)


@pytest.mark.parametrize("light", ["sun", "1/2", "1/2/3/4", "", "0/0/0", "1/nan/0"])
def test_a_light_is_a_direction(light):
    with pytest.raises(ValueError, match="light"):
        AppearanceChoices(light=light).appearance(BOX)


@pytest.mark.parametrize("ramp", ["0.5", "a/b", "0.1/0.2/0.3"])
def test_a_ramp_is_two_numbers(ramp):
    with pytest.raises(ValueError, match=r"gradient-opacity .*; give 2 numbers as a,b"):
        AppearanceChoices(gradient_opacity=ramp).appearance(BOX)


def test_a_raw_file_is_told_its_shape_type_and_spacing(tmp_path):
    values = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    (tmp_path / "a.bin").write_bytes(values.tobytes())
    source = ReadOptions(shape="4x3x2", dtype="int16", spacing="1x1x1.5")
    volume = opened(source, str(tmp_path / "a.bin"))
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == [1, 1, 1.5]


@pytest.mark.parametrize(
    ("choice", "dtype"),
    [
        ({"dtype": ">i2"}, ">i2"),
        ({"dtype": "<i2"}, "<i2"),
        ({"dtype": "int16"}, "<i2"),
        ({"dtype": "int16", "endian": "big"}, ">i2"),
        ({"dtype": ">i2", "endian": "big"}, ">i2"),
        ({"dtype": "int16", "reader": "raw:endian=big"}, ">i2"),
        ({"reader": "raw:dtype=>i2"}, ">i2"),
    ],
)
def test_the_order_of_bytes_is_told_once(choice, dtype, tmp_path):
    values = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    (tmp_path / "a.bin").write_bytes(values.astype(dtype).tobytes())
    volume = opened(ReadOptions(shape="4x3x2", **choice), str(tmp_path / "a.bin"))
    assert np.array_equal(volume.values, values)


def test_a_reader_is_chosen_by_name(tmp_path):
    (tmp_path / "a.bin").write_bytes(bytes(8 + 27))
    volume = opened(
        ReadOptions(reader="raw:offset=8,shape=3x3x3,dtype=uint8"), str(tmp_path / "a.bin")
    )
    assert volume.values.shape == (3, 3, 3)


def test_the_spacing_takes_the_place_of_the_files():
    assert opened(ReadOptions(spacing="2x3x4"), "checker-box:size=4").spacing.tolist() == [2, 3, 4]
    assert opened(ReadOptions(), "checker-box:size=4").spacing.tolist() == [1, 1, 1]


def test_a_file_comes_before_a_generated_volume_of_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("checker-box.npy", np.zeros((2, 3, 4), np.uint8))
    (tmp_path / "checker-box.npy").rename("checker-box")
    assert opened(ReadOptions(reader="npy"), "checker-box").values.shape == (2, 3, 4)


@pytest.mark.parametrize(
    ("choice", "complaint"),
    [
        (
            {"shape": "4x4x4", "dtype": "uint8", "reader": "nrrd"},
            "shape and dtype are for raw files",
        ),
        ({"dtype": "int16", "reader": "raw:dtype=int8"}, "give dtype once, not to the reader"),
        ({"dtype": ">i2", "endian": "little"}, "'>i2' is big-endian, endian says little"),
        ({"spacing": "0x1x1"}, "three positive numbers"),
        ({"spacing": "nanx1x1"}, "three positive numbers"),
        ({"spacing": "1x1"}, "three positive numbers"),
        ({"shape": "4x4"}, "three positive numbers"),
        ({"dtype": "float128x"}, "dtype is a name like uint8"),
    ],
)
def test_a_source_that_makes_no_sense_is_refused(choice, complaint):
    with pytest.raises(ValueError, match=complaint):
        opened(ReadOptions(**choice), "checker-box:size=4")


def test_an_unknown_reader_lists_the_known():
    with pytest.raises(LookupError, match="known readers: bioio, cube, dicom"):
        opened(ReadOptions(reader="foo"), "checker-box:size=4")


def test_an_empty_name_is_not_the_working_folder():
    with pytest.raises(ValueError, match="the volume has no name"):
        opened(ReadOptions(), "")
