"""Old name of `resample_dropins.ndimage`, which another package has."""

import sys

from resample.lazy import elsewhere

sys.modules[__name__] = elsewhere("resample_dropins.ndimage", "hybrid-resample-dropins")
