"""Options of the camera of the new picture."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import (
    LENS,
    SIZE,
    Hyphen,
    OptionTopic,
    Shape,
    check_intrinsics,
    with_intrinsics,
)
from resample.command.settings import Choices, height_and_width
from resample.messages import numbers_in

if TYPE_CHECKING:
    from resample.cameras.models import AnyConvention, Camera
    from resample.types import Doubles
    from resample_warp3d.projection_models import CameraModel


class TargetCamera(Choices):
    """Projection, intrinsics and size of the new picture."""

    heading: ClassVar[str] = "Camera"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    target_intrinsics: Annotated[
        str | None,
        LENS,
        Hyphen,
        Field(
            description="fx,fy,cx,cy[,skew] of the new picture, or a file as for --intrinsics. "
            "[default: the source's, fitted to the size]"
        ),
    ] = None
    target_fov: Annotated[
        float | None,
        Field(
            description="Field of view along the new picture's shorter side, degrees; instead of "
            "intrinsics."
        ),
    ] = None
    target_lens: Annotated[
        str | None,
        LENS,
        Hyphen,
        Field(
            description="Lens of the new picture, as for --lens, instead of intrinsics. [default: "
            "none]"
        ),
    ] = None
    target_projection: Annotated[
        Literal["pinhole", "equirectangular", "orthographic"] | None,
        Field(
            description="Projection of the new picture, as for --source-projection. [default: the "
            "source's, or pinhole if intrinsics are given]"
        ),
    ] = None
    target_pixel_size: Annotated[
        float | None,
        Field(gt=0, description="Orthographic: distance between pixels, scene units."),
    ] = None
    size: Annotated[
        str | None,
        Field(description=f"{SIZE} [default: the source's]"),
    ] = None

    def check_target(self) -> None:
        """Refuse wrong options before any file is read."""
        pinhole = {
            "target-intrinsics": self.target_intrinsics,
            "target-fov": self.target_fov,
            "target-lens": self.target_lens,
        }
        given = [name for name, way in pinhole.items() if way is not None]
        if len(given) > 1:
            raise ValueError(f"give one of --{' and --'.join(given)}, not both")
        if given and self.target_projection not in (None, "pinhole"):
            raise ValueError(
                f"--{given[0]} is for a pinhole; leave it out with --target-projection"
                f" {self.target_projection}"
            )
        if (self.target_projection == "orthographic") != (self.target_pixel_size is not None):
            raise ValueError(
                "--target-pixel-size and --target-projection orthographic belong together; give"
                " both"
            )
        if self.target_intrinsics is not None:
            check_intrinsics("target-intrinsics", self.target_intrinsics)
        if self.target_lens is not None:
            from resample.cameras.calibrations import read_lens

            read_lens(self.target_lens)

    def shape(self, source: Shape) -> Shape:
        """Return height and width of the new picture."""
        return source if self.size is None else height_and_width(self.size)

    def camera_model(
        self, source: "CameraModel", source_shape: Shape, convention: "AnyConvention"
    ) -> "CameraModel":
        """Return the camera of the new picture, at the source's pose."""
        from resample.cameras.calibrations import read_calibration
        from resample.cameras.models import Camera, Orthographic
        from resample.cameras.pixels import Equirectangular, check_panorama

        shape, pose = self.shape(source_shape), source.world_to_camera
        if self.target_fov is not None:
            return Camera.from_fov(self.target_fov, *shape).moved(pose)
        if self.target_lens is not None:
            return read_calibration(self.target_lens).sized(*shape).moved(pose)
        if self.target_intrinsics is not None:
            given = with_intrinsics("target-intrinsics", self.target_intrinsics, convention)
            aimed = given.sized(*shape)
            if aimed.distortion is not None:
                raise ValueError(
                    f"{self.target_intrinsics} has a lens; give it as --target-lens, or give"
                    " --target-intrinsics as fx,fy,cx,cy"
                )
            return aimed.moved(pose)
        if self.target_pixel_size is not None:
            scale = 1.0 / self.target_pixel_size
            return Orthographic(scale, scale, shape[1] / 2, shape[0] / 2, pose)
        wanted = self.target_projection
        is_around = isinstance(source, Equirectangular)
        if wanted == "equirectangular" or (wanted is None and is_around):
            check_panorama(shape)
            return Equirectangular(pose)
        if isinstance(source, Camera):
            return Camera(source.resized(source_shape, shape).matrix, pose)
        if wanted == "pinhole" or isinstance(source, Equirectangular):
            raise ValueError("a pinhole view needs --target-fov or --target-intrinsics")
        right, down = shape[1] / source_shape[1], shape[0] / source_shape[0]
        return Orthographic(
            source.sx * right, source.sy * down, source.cx * right, source.cy * down, pose
        )


class Aim(TargetCamera):
    """Pose and camera of the new picture."""

    pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(
            description="File or file:frame of a pose: 4 x 4 numbers that map world to camera, or "
            "poses of TUM, Open3D (.log, .json), NeRF (.json), COLMAP (images.txt, images.bin) or "
            ".toml."
        ),
    ] = None
    move: Annotated[
        str | None,
        Hyphen,
        Field(description="Move the camera by x,y,z: right, down and forward, scene units."),
    ] = None
    turn: Annotated[
        str | None,
        Hyphen,
        Field(
            description="Turn the view right, up and clockwise by degrees: yaw,pitch,roll, "
            "once moved."
        ),
    ] = None

    def check(self) -> None:
        """Refuse wrong options before any file is read."""
        if not self.model_fields_set:
            raise ValueError("give a viewpoint: --pose FILE, or --move x,y,z and --turn y,p,r")
        self.step()
        self.shape((1, 2))
        self.check_target()

    def step(self) -> "Doubles":
        """Return the pose of the moved and turned camera, relative to the initial one."""
        from resample_warp3d.projection_models import stepped

        move = [0.0, 0.0, 0.0] if self.move is None else numbers_in("move", self.move, 3)
        turn = [0.0, 0.0, 0.0] if self.turn is None else numbers_in("turn", self.turn, 3)
        return stepped(move, turn)

    def camera_model(
        self, source: "CameraModel", source_shape: Shape, convention: "AnyConvention"
    ) -> "CameraModel":
        from resample.cameras.files import read_pose

        seen = super().camera_model(source, source_shape, convention)
        pose = source.world_to_camera if self.pose is None else read_pose(self.pose)
        return seen.moved(self.step() @ pose)

    def camera(
        self, source: "Camera", source_shape: Shape, convention: "AnyConvention"
    ) -> "Camera":
        """Return the pinhole camera of the new picture, for methods that draw no other."""
        from resample.cameras.models import Camera

        seen = self.camera_model(source, source_shape, convention)
        if not isinstance(seen, Camera) or seen.distortion is not None:
            raise ValueError("methods are compared in a pinhole view; give --target-intrinsics")
        return seen
