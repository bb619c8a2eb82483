"""Old name of `resample_dropins.scikit`, which another package has."""

import sys

from resample.lazy import elsewhere

sys.modules[__name__] = elsewhere("resample_dropins.scikit", "hybrid-resample-dropins")
