"""What commands for clouds were called here, until the next release; now `resample-points`."""

from typing import ClassVar

from resample.command.about import OptionTopic
from resample.command.applications import launcher, mention_move
from resample.command.flags import Steady, Up, Viewed
from resample.command.settings import CAMERA, Choices, Serving
from resample.memory import ALLOWED


class FormerStart(Choices):
    """Camera around a point cloud, for `resample-points view`."""

    heading: ClassVar[str] = CAMERA
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    camera: Viewed = "30/20/1"
    up: Up = "z"
    steady: Steady = False


def view_cloud(file: str, start: FormerStart, page: Serving) -> None:
    """Show a cloud by `resample-points view`, within the memory of this command."""
    from resample.view.exports import option_words
    from resample.view.views import settings_of

    mention_move("resample-warp3d view", "points", "view")
    allowed = ALLOWED.get()
    memory = {} if allowed is None else {"memory": f"{allowed / 1024}KiB"}
    launcher("points", "view")(file, *option_words({**memory, **settings_of((start, page))}))
