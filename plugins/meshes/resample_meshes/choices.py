"""Options of the command line for meshes."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from resample.command.flags import FieldOfView, OptionTopic, Up, Viewed, viewpoint
from resample.command.settings import Choices, FrameFormat
from resample_texture.command.choices import INTERPOLATIONS

if TYPE_CHECKING:
    from resample.cameras.models import AnyCamera
    from resample.cameras.viewpoints import Viewpoint
    from resample_meshes.rendering import Mesh, MeshStyle


class MeshView(Choices):
    """Camera and lighting of a mesh."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    camera: Viewed = "30,20,1"
    fov: FieldOfView = 30.0
    up: Up = "y"
    shading: Annotated[bool, Field(description="Light surfaces: by a light at the camera.")] = False

    def placed(self, mesh: "Mesh", size: tuple[int, int]) -> "AnyCamera":
        """Return the camera for a picture (height, width) of a mesh.

        Raises
        ------
        ValueError
            These are not a camera's numbers.
        """
        from resample.cameras.viewpoints import camera_from
        from resample_meshes.rendering import ball_around

        return camera_from(self.viewpoint(), ball_around(mesh), *size)

    def viewpoint(self) -> "Viewpoint":
        """Return the viewpoint."""
        return viewpoint(self.camera, self.fov, self.up)


class MeshDrawing(Choices):
    """Interpolation and pixel filter of a mesh."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    interpolation: Annotated[str, Field(description=INTERPOLATIONS)] = "area-spline"
    filter: Annotated[str, Field(description="Pixel filter, such as gaussian:sigma=0.6.")] = "box"

    def style(self, shading: bool) -> "MeshStyle":
        """Return the style that `render_mesh` takes.

        Raises
        ------
        ValueError, LookupError
            A plugin is unknown or refuses its parameters.
        """
        from resample import registry
        from resample_meshes.rendering import MeshStyle

        return MeshStyle(
            interpolation=registry.build("interpolations", self.interpolation),
            pixel_filter=registry.build("filters", self.filter),
            shading=shading,
        )


class MeshFormat(FrameFormat):
    """Size, texture, background and bits of a mesh's picture."""

    texture: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="Picture to use in place of the textures that the file names. [default: "
            "none]"
        ),
    ] = None
