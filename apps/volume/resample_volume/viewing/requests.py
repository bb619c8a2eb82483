"""What a page asks of a volume's picture: options, parsed, with what they have in common kept."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from resample.command.settings import PictureFormat, Resampling, chosen
from resample.outofcore.caching import Memo, memoizing
from resample.resampler import Resampler
from resample.view.views import Settings
from resample_volume.command.choices import AppearanceChoices, Beside
from resample_volume.media.appearance import Appearance
from resample_volume.types import Volume

SHOWN = (AppearanceChoices, Resampling, Beside, PictureFormat)  # options that a page changes
STILL = AppearanceChoices()
STEERED = ("camera", "fov", "up", "fit")  # options that only move the camera
MOST_COMPARED = 2  # looks that are kept


class VolumeRequest(NamedTuple):
    """A request, parsed from options."""

    choices: AppearanceChoices
    appearance: Appearance
    resampler: Resampler
    beside: Beside
    picture: PictureFormat


@dataclass
class VolumeRequests:
    """Requests for pictures of one volume; looks, resamplers and statistics are kept.

    Parameters
    ----------
    volume
        Without padding.
    """

    volume: Volume
    _resamplers: dict[Resampler, Resampler] = field(default_factory=dict)  # which keep tables
    _found: Memo = field(default_factory=dict)
    _appearances: dict[Any, Appearance] = field(default_factory=dict)  # of the last requests

    def parsed(self, settings: Settings) -> VolumeRequest:
        """Return the request that options make.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file of one cannot
        be read.
        """
        look, resampling, beside, picture = chosen(settings, SHOWN)
        resampler = look.renderer(resampling, self.volume.scale)
        resampler = self._resamplers.setdefault(resampler, resampler)
        appearance = self._appearance(look, resampler, beside)
        return VolumeRequest(look, appearance, resampler, beside, picture)

    def _appearance(
        self, look: AppearanceChoices, resampler: Resampler, beside: Beside
    ) -> Appearance:
        """Return the look of the voxels, cached while only the camera moves."""
        still = {name: getattr(STILL, name) for name in STEERED}
        key = look.model_copy(update=still), resampler, beside.mesh, beside.plane, beside.surface
        appearance = self._appearances.get(key)
        if appearance is None:
            with memoizing(self._found):
                appearance = look.appearance(self.volume, resampler)
            appearance = beside.scene_objects(look, resampler).beside(appearance)
            before = list(self._appearances.items())[1 - MOST_COMPARED :]
            # Replaced whole: picks ask meanwhile.
            self._appearances = {**dict(before), key: appearance}
        return appearance
