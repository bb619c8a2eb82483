"""Options of the camera that took the source picture."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import (
    CALIBRATED,
    COUNTED,
    FILES,
    LENS,
    Hyphen,
    OptionTopic,
    Shape,
    check_intrinsics,
    tell_radians,
    with_intrinsics,
)
from resample.command.settings import Choices, Convention
from resample.messages import numbers_in

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample.cameras.trajectories import PosedPicture
    from resample_warp3d.projection_models import CameraModel

FOV = 60.0  # degrees along the shorter side, assumed if unknown


class SourceCamera(Choices):
    """The camera of the source picture."""

    heading: ClassVar[str] = "Source camera"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    intrinsics: Annotated[
        str | None,
        LENS,
        Hyphen,
        Field(description=f"fx,fy,cx,cy[,skew] in px; fy may be negative; or {FILES}."),
    ] = None
    fov: Annotated[
        float | None,
        Field(
            description="Field of view along the shorter side in degrees; in place of intrinsics."
        ),
    ] = None
    lens: Annotated[
        str | None,
        LENS,
        Hyphen,
        Field(description=f"{CALIBRATED}, instead of intrinsics; k=k1,k2,p1,p2[,k3...] with them."),
    ] = None
    convention: Annotated[Convention, Field(description=f"{COUNTED} cx and cy.")] = "corner"
    source_pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(
            description="Pose of the picture's camera: file or file:frame, as for --pose; may "
            "contain intrinsics. [default: the identity]"
        ),
    ] = None

    source_projection: Annotated[
        Literal["pinhole", "equirectangular", "orthographic"],
        Field(
            description="Projection of the picture: pinhole (also with a lens), equirectangular "
            "(all directions, twice as wide as high, depth along the rays), or orthographic."
        ),
    ] = "pinhole"
    pixel_size: Annotated[
        float | None,
        Field(gt=0, description="Orthographic: distance between pixels, scene units."),
    ] = None

    def check(self) -> None:
        """Refuse wrong options before any file is read."""
        from resample.cameras.calibrations import read_lens
        from resample.cameras.models import Camera

        if self.source_projection == "pinhole":
            if self.pixel_size is not None:
                raise ValueError("--pixel-size belongs to --source-projection orthographic")
            tell_radians(self.fov)
            whole_lens = None if self._coefficients else self.lens
            ways = {"--intrinsics": self.intrinsics, "--fov": self.fov, "--lens": whole_lens}
            given = [name for name, way in ways.items() if way is not None]
            if len(given) > 1:
                raise ValueError(f"give one of {' and '.join(given)}, not both")
            if self.intrinsics is not None:
                check_intrinsics("intrinsics", self.intrinsics)
            elif not given and self.source_pose is None:
                raise ValueError(
                    "give --intrinsics fx,fy,cx,cy or a --lens, or --fov 60 if they are unknown"
                )
            if whole_lens is not None:
                read_lens(whole_lens)
            elif self._coefficients:
                Camera.from_fov(60.0, 1, 1).with_lens(self._coefficients)
            return
        pinhole = {"intrinsics": self.intrinsics, "fov": self.fov, "lens": self.lens}
        for name, way in pinhole.items():
            if way is not None:
                raise ValueError(
                    f"--{name} is for a pinhole; leave it out with --source-projection"
                    f" {self.source_projection}"
                )
        if (self.source_projection == "orthographic") != (self.pixel_size is not None):
            raise ValueError(
                "--pixel-size and --source-projection orthographic belong together; give both"
            )

    def check_pinhole(self, command: str) -> None:
        """Refuse other projections for a command."""
        if self.source_projection != "pinhole":
            raise ValueError(
                f"{command} needs pictures of a pinhole or lens; for --source-projection"
                f" {self.source_projection} use render or animate"
            )

    @property
    def _coefficients(self) -> list[float]:
        """Coefficients of a lens given without intrinsics; empty for other lenses."""
        name, _, numbers = (self.lens or "").partition("=")
        return numbers_in("lens", numbers) if name == "k" else []

    def guessed(self) -> "SourceCamera":
        """Return these options with a default field of view if nothing is known of a pinhole."""
        if self.source_projection != "pinhole":
            return self
        ways = (self.intrinsics, self.fov, self.lens, self.source_pose)
        return self.model_copy(update={"fov": FOV}) if all(w is None for w in ways) else self

    def of_recording(self, color: str) -> "SourceCamera":
        """Return these options with the camera of a frame of Record3D, unless another is given."""
        path = color if ":" not in color else color.rpartition(":")[0]
        ways = (self.intrinsics, self.fov, self.lens, self.source_pose)
        if not path.lower().endswith(".r3d") or any(way is not None for way in ways):
            return self
        return self.model_copy(update={"source_pose": color if path != color else f"{color}:0"})

    def camera_model(self, shape: Shape, pose: str | None = None) -> "CameraModel":
        """Return the camera of a picture (height, width), of any projection."""
        import numpy as np

        from resample.cameras.files import read_pose
        from resample.cameras.models import Orthographic
        from resample.cameras.pixels import Equirectangular

        if self.source_projection == "pinhole":
            return self.camera(shape, pose)
        name = self.source_pose if pose is None else pose
        place = np.eye(4) if name is None else read_pose(name)
        if self.pixel_size is None:
            return Equirectangular(place)
        scale, (height, width) = 1.0 / self.pixel_size, shape
        return Orthographic(scale, scale, width / 2, height / 2, place)

    def camera(self, shape: Shape, pose: str | None = None) -> "Camera":
        """Return the pinhole or lens camera of a picture (height, width)."""
        from resample.cameras.calibrations import read_calibration
        from resample.cameras.files import read_pose, read_shot
        from resample.cameras.trajectories import PosedPicture

        name = self.source_pose if pose is None else pose
        whole_lens = None if self._coefficients else self.lens
        is_known = any(way is not None for way in (self.intrinsics, self.fov, whole_lens))
        shot = None
        if name is not None:  # with a camera given here, the file's may be of any kind
            shot = PosedPicture("", read_pose(name)) if is_known else read_shot(name)
        if self._coefficients:
            return self._without_lens(shape, name, shot).with_lens(self._coefficients)
        if self.lens is not None:
            camera = read_calibration(self.lens).sized(*shape)
            return camera if shot is None else camera.moved(shot.pose)
        return self._without_lens(shape, name, shot)

    def _without_lens(
        self, shape: Shape, name: str | None, shot: "PosedPicture | None"
    ) -> "Camera":
        """Return the camera of intrinsics, a field of view, or the pose file."""
        from resample.cameras.models import Camera

        place = None if shot is None else shot.pose
        if self.fov is not None:
            return Camera.from_fov(self.fov, *shape, place)
        if self.intrinsics is not None:
            camera = with_intrinsics("intrinsics", self.intrinsics, self.convention).sized(*shape)
            return camera if place is None else camera.moved(place)
        if shot is None or shot.camera is None or shot.shape is None:
            raise ValueError(f"{name} has no intrinsics; give --intrinsics fx,fy,cx,cy or --fov 60")
        return shot.camera.resized(shot.shape, shape)
