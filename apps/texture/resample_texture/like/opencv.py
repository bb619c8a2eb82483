"""Old name of `resample_dropins.opencv`, which another package has."""

import sys

from resample.lazy import elsewhere

sys.modules[__name__] = elsewhere("resample_dropins.opencv", "hybrid-resample-dropins")
