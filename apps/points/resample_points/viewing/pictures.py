"""Pictures of points, 3D Gaussians and particles without a page."""

from resample.view.files import picture_function
from resample_points.viewing import view_of

picture = picture_function(view_of)
