"""`resample-volume compare`."""

import sys
from typing import Annotated, ClassVar, Literal

from cyclopts import Parameter

from resample.command import flags
from resample.command.flags import OptionTopic
from resample.command.settings import Choices, Iso, PictureFormat, Resampling, Shown
from resample_comparisons.options import Json, method_names, rows_as_json
from resample_volume.command.choices import AppearanceChoices, ReadOptions


class Projecting(Choices):
    """The projection: what a pixel shows."""

    heading: ClassVar[str] = "Projection"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    projection: Shown = "composite"
    iso: Iso = None

    def resampling(self) -> Resampling:
        """Return the options of the renderer, with defaults filled in.

        Raises
        ------
        ValueError
            An X-ray is asked for.
        """
        if self.projection == "xray":
            raise ValueError("compare measures plain sums; take the projection additive")
        return Resampling(projection=self.projection, iso=self.iso)


Unshown = Parameter(show_default=False)
SOURCE, PROJECTING = ReadOptions.usual(), Projecting.usual()
# In a small picture voxels are small, and primitives differ.
FAR_APPEARANCE = AppearanceChoices.usual().model_copy(update={"camera": "30,20,0.8"})
FEW_PIXELS = f"{flags.SIZE} Small, as methods differ where voxels are small on screen."
MOST_RAYS = 32


def compare(
    volume: str,
    /,
    *,
    methods: flags.AppearanceFlag[str] = "points,splats,hybrid",
    footprints: Annotated[str, OptionTopic.APPEARANCE, Unshown] = "",
    orders: Annotated[str, OptionTopic.APPEARANCE, Unshown] = "",
    peer: Annotated[Literal["vtk"] | None, OptionTopic.APPEARANCE, flags.Switch] = None,
    reference: flags.AppearanceFlag[Literal["splats", "rays"]] = "splats",
    output: flags.OptionalOutput = None,
    difference: Annotated[bool, OptionTopic.APPEARANCE, flags.Switch] = False,
    rays: flags.AppearanceFlag[int] = 8,
    as_json: Json = False,
    look: Annotated[AppearanceChoices, flags.Flat] = FAR_APPEARANCE,
    projection: Annotated[Projecting, flags.Flat] = PROJECTING,
    size: Annotated[flags.Size, Parameter(help=FEW_PIXELS)] = "96",
    source: Annotated[ReadOptions, flags.Flat] = SOURCE,
) -> None:
    """Render a volume by several methods, footprints, orders and peers, and measure their errors.

    For example:

        resample-volume compare checker-box
        resample-volume compare checker-box --methods points,hybrid -o compare.png
        resample-volume compare checker-box --orders every-sample,axis-sheets

    Parameters
    ----------
    volume
        A file, a folder of slices, or checker-box, vessel-tree, marschner-lobb.
    methods
        Methods separated by commas; of hybrid, points, splats, paper, inflate, ewa.
    footprints
        Splat models separated by commas; of exact, corrected, projected, affine, equation.
        [default: the one of each method]
    orders
        Compositing orders separated by commas; of every-sample, axis-sheets,
        image-sheets:thickness=0.5, rays. [default: the order of render]
    peer
        Also VTK's ray caster, at 1 and 4 x 4 rays per pixel; needs the extra peers.
    reference
        Reference: exact splats in the first order, or rays through the field (slow).
    output
        Written to: all pictures side by side (.png).
    difference
        Show the errors, too, magnified.
    rays
        Rays of the reference per side of a pixel, 1 to 32.
    """
    from resample.command.session import Session, require_picture
    from resample.files.writing import check_targets
    from resample.measuring.compare import check_sheet, contact_sheet, plain
    from resample.profiles.orders import Summing
    from resample_comparisons.volume.compare import (
        Contest,
        check_vtk,
        gathered_for,
        variants,
    )
    from resample_volume.command.inputs import prepared, require_values
    from resample_volume.command.rendering import BYTES_PER_PIXEL, scene_of
    from resample_volume.voxels.framing import centered

    pixels = PictureFormat(size=size).height_and_width()
    look = look.of_voxels()
    first = look.renderer(projection.resampling(), source.scale)
    choice = variants(first, _words(methods), _words(footprints), method_names(orders, least=0))
    if not 1 <= rays <= MOST_RAYS:
        raise ValueError(f"{rays} rays per side of a pixel; 1 to {MOST_RAYS} are allowed")
    if output is not None:
        check_sheet(output)
    elif difference:
        raise ValueError("differences are shown in a picture; give its name by --output")
    viewpoint = look.viewpoint()
    check_targets(output)
    require_picture(pixels, BYTES_PER_PIXEL)
    scene = prepared(source, volume)
    require_values(scene, "a comparison")
    appearance = look.appearance(scene, first)
    if peer is not None:
        check_vtk(appearance, first)
    first = next(iter(choice.values()))
    painters = [one for one in choice.values() if one.order.summing is not Summing.RAYS]
    subject = scene_of(Session(), [(scene, appearance)], (painters or [first])[0], look.fit)
    gathered = gathered_for(choice, scene, appearance)
    contest = Contest(subject, gathered, subject.camera(viewpoint, *pixels), pixels)
    (contest.cast if reference == "rays" else contest.splatted)(first, rays)
    for name, resampler in choice.items():
        contest.draw(name, resampler)
    for count in () if peer is None else (1, 4):
        contest.draw_vtk(centered(scene)[0], count)
    if output is not None:
        notes = {
            str(row["picture"]): f"{row['psnr']:.2f} dB, {row['ms']:.0f} ms" for row in contest.rows
        }
        errors = contest.differences() if difference else {}
        contact_sheet(contest.pictures | errors, output, captions=notes)
    sys.stdout.write(rows_as_json(contest.rows) if as_json else plain(contest.rows))


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
