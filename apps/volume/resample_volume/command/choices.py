"""What the command line lets a user choose about a volume and its look; no numerics in here."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from cyclopts import Parameter
from pydantic import Field

from resample.command.about import TRANSFER, About
from resample.command.flags import FieldOfView, Hyphen, Switch, Up, Viewed, under
from resample.command.settings import (
    CAMERA,
    LIGHT,
    MEMORY,
    Choices,
    Iso,
    Resampling,
    Shown,
)
from resample.console.backgrounds import Color
from resample_volume.looks.names import PRESETS, TISSUES

if TYPE_CHECKING:
    from pathlib import Path

    from resample.cameras.viewpoints import Viewpoint
    from resample.resampler import Resampler
    from resample_volume.command.filling import Fitted
    from resample_volume.media.appearance import Appearance, Met
    from resample_volume.space.annotations import Annotations
    from resample_volume.types import Volume

Several = Parameter(allow_leading_hyphen=True, negative="", show_default=False)
Lit = under(LIGHT)


class Source(Choices):
    """What is read, where the file alone does not say it."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[About] = About.LOOK

    reader: Annotated[
        str | None, Field(description="Reader by name, such as raw:offset=512. By suffix.")
    ] = None
    shape: Annotated[
        str | None, Field(description="Voxels of a raw file along x, y, z, and times: 256x256x128.")
    ] = None
    dtype: Annotated[
        str | None, Field(description="Type of a raw file: uint8, int16, or >i2 for big-endian...")
    ] = None
    endian: Annotated[
        Literal["little", "big"] | None,
        Field(description="Order of a raw file's bytes. Little."),
    ] = None
    spacing: Annotated[
        str | None, Hyphen, Field(description="Distances between voxels: 1x1x1.4. From the file.")
    ] = None
    memory: Annotated[
        str | None,
        About.RESOURCE,
        Field(
            description=f"{MEMORY}; the voxels of a chunked volume (OME-Zarr, zarr) may take that, "
            "or half of the free memory."
        ),
    ] = None
    level: Annotated[
        int | None,
        Field(
            ge=0,
            description="Level of detail; 0 is the finest. Of an OME-Zarr that has several sizes, "
            "see info.",
        ),
    ] = None
    units: Annotated[
        Literal["hu", "hu+1024", "none"] | None,
        Field(
            description="What values are: Hounsfield units, these as stored with 1024 added, or "
            "none of them. As the file says, or as the values look."
        ),
    ] = None

    scale: Annotated[
        str,
        Field(
            description="Show values, or their logarithms: linear, log, or symlog:linear=0.01, "
            "which is linear up to there at either side of 0. Looks and windows are in the "
            "values' own units."
        ),
    ] = "linear"
    time: Annotated[
        int | None,
        Hyphen,
        Field(description="One of the times that a file holds, from 0 on; -1 is the last."),
    ] = None
    channel: Annotated[
        int | None,
        Hyphen,
        Field(description="One of the channels that a file holds, from 0 on; else its colors."),
    ] = None


class Added(Choices):
    """What is shown in the same scene."""

    heading: ClassVar[str] = "Further volumes"
    about: ClassVar[About] = About.LOOK

    also: Annotated[
        tuple[str, ...],
        About.SOURCE,
        Several,
        Field(
            description="Another volume in the same scene, where its file says it is: pet.nrrd, "
            "or pet.nrrd:window=5/10,transfer=hot:opacity=0.3; of time, channel, level, units, "
            "spacing, window and, last, transfer. Where volumes overlap, extinctions add up."
        ),
    ] = ()
    channels: Annotated[
        str | None,
        TRANSFER,
        Field(
            description="What each channel of the file looks like: red,#00ff80,none or "
            "gray,300..900,auto:opacity=0.2; a color, what transfer takes, or none."
        ),
    ] = None


class Look(Choices):
    """What voxels look like and from where."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[About] = About.LOOK

    transfer: Annotated[
        str,
        TRANSFER,
        Hyphen,
        Field(
            description="Transfer function: auto, which looks at the values; "
            f"{', '.join(PRESETS)}; for CT {', '.join(TISSUES)}; a matplotlib colormap; a range of "
            "values such as 300..900; points of value, color and opacity such as "
            "40/red/0,90/white/0.5; or a .json or .toml file of points over values, or of "
            "regions over values and gradients. After a name :opacity=0.2,low=0.3 thins it, "
            "color=tomato colors it, gradient=0.1/0.5 keeps its surfaces. Several materials: "
            "skin:opacity=0.1+bone."
        ),
    ] = "auto"
    window: Annotated[
        str | None,
        Hyphen,
        Field(
            description="Center and width of the values that auto, gray, bone, vessels, surfaces "
            "and colormaps are spread over, or the ends of these: 40/400, -160..240; of an X-ray, "
            "its line integrals. The range without padding and strays."
        ),
    ] = None
    opacity_unit: Annotated[
        float | None,
        Field(
            gt=0,
            allow_inf_nan=False,
            description="Length in scene units over which opacities hold. A voxel's size.",
        ),
    ] = None
    camera: Viewed = "30/20/1"
    fov: FieldOfView = 30.0
    up: Up = "z"
    fit: Annotated[
        Literal["visible", "volume"],
        under(CAMERA),
        Field(description="Angles are around what is visible, or the volume whatever is."),
    ] = "visible"
    shading: Annotated[bool, Lit, Field(description="Light surfaces: from where light says.")] = (
        True
    )
    light: Annotated[
        str,
        Hyphen,
        Lit,
        Field(description="Where light comes from: eye, or a scene direction such as 1/-1/2."),
    ] = "eye"
    ambient: Annotated[
        float, Lit, Field(ge=0, allow_inf_nan=False, description="Light that is everywhere.")
    ] = 0.3
    diffuse: Annotated[
        float, Lit, Field(ge=0, allow_inf_nan=False, description="Light by its angle to surfaces.")
    ] = 0.7
    specular: Annotated[
        float,
        Lit,
        Field(ge=0, allow_inf_nan=False, description="Strength of the white highlights."),
    ] = 0.2
    shininess: Annotated[
        float,
        Lit,
        Field(gt=0, allow_inf_nan=False, description="The greater, the smaller highlights."),
    ] = 32.0
    shadows: Annotated[
        bool, Lit, Field(description="What lies toward the light takes of it; light must be given.")
    ] = False
    ambient_occlusion: Annotated[
        bool, Lit, Field(description="Ambient light is less where much is near.")
    ] = False
    gradient: Annotated[
        Literal["central", "sobel"], Field(description="How surfaces' normals are found.")
    ] = "central"
    gradient_opacity: Annotated[
        str | None,
        Field(
            description="Fade even regions: opacity rises between these fractions of the "
            "steepest gradient, such as 0.1/0.5."
        ),
    ] = None

    classify: Annotated[
        Literal["auto", "pre", "post"],
        Field(
            description="Pre: voxels get colors, which are reconstructed. Post: the values are "
            "reconstructed and get colors then, which is sharper. Auto: post along rays; pre if a "
            "method is given, for several volumes and for what memory does not hold as a field."
        ),
    ] = "auto"
    labels: Annotated[
        str | None,
        About.SOURCE,
        Field(description="Volume of whole numbers, a label for each voxel."),
    ] = None
    label: Annotated[
        tuple[str, ...],
        Several,
        Field(description="What a label looks like: 1:color=tomato,opacity=0.5 or 2:hidden."),
    ] = ()
    crop: Annotated[
        str | None, Hyphen, Field(description="Ranges of voxels along x, y, z: 64:192,:,10:")
    ] = None
    clip: Annotated[
        tuple[str, ...],
        Several,
        Field(
            description="Cut through the middle, keep what the normal points to: 1/0/-1, or "
            "1/0/-1/20 moved by 20 scene units."
        ),
    ] = ()
    slab: Annotated[
        str | None,
        Hyphen,
        Field(
            description="Show a slab alone: 20/10, its center behind the volume's middle and its "
            "thickness, scene units along the view; or 20/10/0/0/1, along a scene direction."
        ),
    ] = None
    mu_water: Annotated[
        float | None,
        Field(
            gt=0,
            allow_inf_nan=False,
            description="Attenuation of water in an X-ray, per scene unit (mm). 0.02, near 70 keV.",
        ),
    ] = None
    invert: Annotated[
        bool,
        Switch,
        Field(description="Exchange black and white of projections of values: bones are black."),
    ] = False
    depth_cue: Annotated[
        float | None,
        Field(ge=0, le=1, description="Share of the light that is lost at the far end."),
    ] = None

    def of_voxels(self) -> "Look":
        """The same look of voxels, unless it was said that it is the field's."""
        return self if self.classify == "post" else self.model_copy(update={"classify": "pre"})

    def renderer(self, resampling: Resampling, scale: str = "") -> "Resampler":
        """Renderer that goes with this look, of values on a scale.

        Raises
        ------
        ValueError, LookupError
            A choice is unknown or not allowed, or two do not go together.
        """
        from resample_volume.media.appearance import Classification, check_together
        from resample_volume.media.scales import scale_named
        from resample_volume.space.sections import Section

        if self.label and self.labels is None:
            raise ValueError("label says what a label looks like; give the labels' volume too")
        if (by := scale_named(scale)) is not None and resampling.iso is not None:
            place = by.place(resampling.iso, "iso")
            resampling = resampling.model_copy(update={"iso": place})
        is_auto = self.classify == "auto"
        is_of_field = self.classify == "post" or (is_auto and not resampling.is_of_samples)
        quality = "usual" if is_auto else "best"
        resampler = resampling.resampler(of_field=is_of_field, quality=quality)
        chosen = {
            "labels": self.labels,
            "gradient-opacity": self.gradient_opacity,
            "depth-cue": self.depth_cue,
            "xray": self.mu_water,
            "invert": self.invert or None,
        }
        if self.slab is not None:
            Section.of(self.slab)
        extras = [name for name, choice in chosen.items() if choice is not None]
        check_together(resampler, Classification(self.classify), extras)
        return resampler

    def appearance(self, volume: "Volume", resampler: "Resampler | None" = None) -> "Appearance":
        """Look of the voxels under a renderer; None is one that composites them.

        Raises
        ------
        ValueError
            A choice is unknown or not allowed.
        """
        from resample.painting.choices import MEASURING, Projection
        from resample_volume.looks.labels import read_labels
        from resample_volume.media.appearance import Appearance, Classification, named_transfer
        from resample_volume.media.xrays import MU_WATER, XRay
        from resample_volume.voxels.shading import DepthCue, Light

        projection = Projection.COMPOSITE if resampler is None else resampler.projection
        window, xray = self._window(volume.scale), None
        if projection is Projection.XRAY:
            xray, window = XRay(self.mu_water or MU_WATER, window), None
        transfer = named_transfer(self.transfer, volume, projection, window)
        framing = None
        if self.transfer == "auto" and projection in MEASURING:  # the camera is that of the others
            framing = named_transfer(self.transfer, volume, Projection.COMPOSITE, window)
        if self.opacity_unit is not None:
            transfer = replace(transfer, opacity_unit=self.opacity_unit)
        toward = None
        if self.light != "eye":
            x, y, z = _numbers("light", self.light, 3)
            toward = (x, y, z)
        if not self.shading and (self.shadows or self.ambient_occlusion):
            raise ValueError("shadows and ambient-occlusion need shading; leave out no-shading")
        light = Light(
            toward,
            self.ambient,
            self.diffuse,
            self.specular,
            self.shininess,
            self.shadows,
            self.ambient_occlusion,
        )
        ramp = None
        if self.gradient_opacity is not None:
            low, high = _numbers("gradient-opacity", self.gradient_opacity, 2)
            ramp = (low, high)
        return Appearance(
            transfer,
            light if self.shading else None,
            self.gradient,
            ramp,
            classification=Classification(self.classify),
            labels=None if self.labels is None else read_labels(self.labels, self.label, volume),
            cue=None if self.depth_cue is None else DepthCue(self.depth_cue),
            crop=self.crop,
            clip=self.clip,
            framing=framing,
            slab=self.slab,
            xray=xray,
            invert=self.invert,
        )

    def _window(self, scale: str) -> tuple[float, float] | None:
        """Least and greatest value of the window, on a scale."""
        from resample_volume.media.scales import scale_named

        if self.window is None:
            return None
        if ".." in self.window:
            low, high = _numbers("window", self.window, 2, "..")
        else:
            center, width = _numbers("window", self.window, 2)
            low, high = center - width / 2, center + width / 2
        if not -math.inf < low < high < math.inf:
            raise ValueError(f"window {self.window!r}; its width must be above 0, as in 40/400")
        if (by := scale_named(scale)) is None:
            return low, high
        return by.place(low, "the window's end"), by.place(high, "the window's end")

    def viewpoint(self) -> "Viewpoint":
        """Where the volume is seen from, as `resample.cameras.files.viewpoint` reads it."""
        from resample.cameras.files import viewpoint

        return viewpoint(self.camera, self.fov, self.up)


class Beside(Choices):
    """What else is seen in the volume's scene."""

    heading: ClassVar[str] = "Annotations and objects"
    about: ClassVar[About] = About.LOOK

    axes: Annotated[
        bool, Switch, Field(description="Draw the scene's axes x, y and z at the volume's corner.")
    ] = False
    box: Annotated[
        bool,
        Switch,
        Field(description="Draw the edges of the volume's box, hidden by what is in front."),
    ] = False
    cube: Annotated[
        bool,
        Switch,
        Field(
            description="Draw a cube that shows where axes point: R L A P S I of a patient, else "
            "+X -X and so on."
        ),
    ] = False
    scale_bar: Annotated[
        bool,
        Switch,
        Field(description="Draw a round length; in perspective it holds at the volume's middle."),
    ] = False
    mesh: Annotated[
        tuple[str, ...],
        About.SOURCE,
        Several,
        Field(
            description="Mesh in the volume's scene: stent.ply:color=tomato,opacity=1 (.ply, .obj, "
            ".stl, .glb). It needs the order rays, in composite or first-hit. Clip does not cut "
            "it, and the fit visible has it in the picture."
        ),
    ] = ()
    plane: Annotated[
        tuple[str, ...],
        Several,
        Field(
            description="Plane that shows values as they are: z=40 (voxels), x=50%, or 1/0/-1/20 "
            "as clip; after a colon window=40/400 (or -160..240), colors=gray (or a matplotlib "
            "colormap), opacity=1. It needs what a mesh needs, and clip does not cut it."
        ),
    ] = ()
    surface: Annotated[
        tuple[str, ...],
        Several,
        Field(
            description="Surface of a value beside the volume: 300:color=ivory,opacity=0.5. It "
            "needs what a mesh needs, and the extra vtk; clip does not cut it."
        ),
    ] = ()

    def annotations(self, background: Color | None = None) -> "Annotations":
        """What is drawn, before a linear color."""
        from resample.measuring.color_bars import DARK, ink_on
        from resample_volume.space.annotations import Annotations

        is_dark = background is not None and ink_on(background) == DARK
        return Annotations(self.axes, self.box, self.cube, self.scale_bar, is_dark)

    def met(self, look: Look, resampler: "Resampler") -> "Met":
        """Meshes and planes that are read, where a renderer shows them.

        Raises
        ------
        ValueError, OSError
            The renderer shows none, or a file cannot be read.
        """
        from resample_volume.media.appearance import Classification, Met, check_together
        from resample_volume.space.image_planes import ImagePlane
        from resample_volume.space.iso_surfaces import IsoSurface
        from resample_volume.space.meshes import read_mesh

        given = {"mesh": self.mesh, "plane": self.plane, "surface": self.surface}
        names = [name for name, texts in given.items() if texts]
        if names:
            check_together(resampler, Classification(look.classify), names)
        planes = tuple(ImagePlane.of(text) for text in self.plane)
        surfaces = tuple(IsoSurface.of(text) for text in self.surface)
        return Met(tuple(read_mesh(text) for text in self.mesh), planes, surfaces)


class BesidePicture(Beside):
    """The same, and what belongs to a single picture."""

    color_bar: Annotated[
        bool,
        Switch,
        Field(description="Add a bar to the right: of colors, opacities and values."),
    ] = False
    zoom_in: Annotated[
        bool,
        Switch,
        Field(
            description="Zoom and pan so that what is visible from there fills the picture, and "
            "say the camera. The zoom of camera multiplies that."
        ),
    ] = False
    deep: Annotated[
        int | None,
        Field(
            ge=1,
            le=1024,
            description="Write so many slabs of depth instead of one layer, to a deep .exr.",
        ),
    ] = None

    def fit(self, look: Look) -> "Fitted":
        """What the camera is placed by."""
        return "picture" if self.zoom_in else look.fit

    def check(self, output: "Path", resampler: "Resampler", height: int) -> None:
        """Refuse a bar or a deep picture that cannot be, before any work is done.

        Raises
        ------
        ValueError
            There is no room for a bar; or the suffix or the projection is none of deep pictures,
            or something is drawn into one.
        """
        if self.color_bar:
            from resample.measuring.color_bars import check_bar

            check_bar(output, height)
        if self.deep is None:
            return
        from resample.files.deep import check_deep
        from resample_volume.space.slabs import check_slabs

        check_deep(output)
        check_slabs(self.deep, resampler)
        if self.color_bar or self.annotations().is_any:
            raise ValueError(
                "deep pictures hold slabs alone; leave out axes, box, cube, scale-bar and color-bar"
            )


class Projecting(Choices):
    """What a pixel shows."""

    heading: ClassVar[str] = "Projection"
    about: ClassVar[About] = About.LOOK

    projection: Shown = "composite"
    iso: Iso = None

    def resampling(self) -> Resampling:
        """Renderer's choices, else the default ones.

        Raises
        ------
        ValueError
            An X-ray is asked for.
        """
        if self.projection == "xray":
            raise ValueError("sums are compared as they are; take the projection additive")
        return Resampling(projection=self.projection, iso=self.iso)

    def painting(self, look: Look) -> Resampling:
        """The same, of what paints samples, also of fields."""
        is_of_field = look.classify == "post" or self.projection != "composite"
        thickness = 1 if self.projection == "maximum" else 0.5
        order = f"image-sheets:thickness={thickness}" if is_of_field else None
        return self.resampling().model_copy(update={"order": order})


def _numbers(name: str, text: str, count: int, joint: str = "/") -> list[float]:
    try:
        numbers = [float(part) for part in text.split(joint)]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        form = joint.join("abc"[:count])
        raise ValueError(f"{name} {text!r}; give {count} numbers as {form}")
    return numbers
