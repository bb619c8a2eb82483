"""Data types shared by all parts of the core, with their shapes and units; they have no behavior.

Conventions used everywhere:

- The pixel in row i, column j covers [j, j + 1) × [i, i + 1); its center is at (j + 0.5, i + 0.5).
- A camera looks along +z, x to the right and y down (OpenCV, COLMAP); poses map world to camera.
- Images are float32, linear light, premultiplied RGBA, shape (H, W, 4).
- Depth is z-depth: the distance along the viewing axis, in scene units.
- Extinction is optical depth per scene unit of length.
"""

import math
from typing import TYPE_CHECKING, Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.showable import Behind, Showable, results

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Records = NDArray[np.void]
Indices = NDArray[np.int64]
Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels
Record = Any  # an element of Records
Single = Any  # a float32 number: half the bytes and twice the vector lanes

NO_PLANES = np.zeros((0, 5))

LAST_SHEET = 2e9  # sheet numbers have 32 bits

# Projections of fields; see `resample.engine.rays`.
COMPOSITE, MAXIMUM, AVERAGE, ADDITIVE, FIRST_HIT, MINIMUM, ATTENUATED = range(7)


class Samples(NamedTuple):
    """N samples of an object in the scene; all have ellipsoids of one shape.

    Examples
    --------
    >>> import numpy as np
    >>> from resample import Camera, Resampler, Samples
    >>> place = np.stack(np.meshgrid([0, 1], [0, 1], [5, 6]), axis=-1).reshape(-1, 3)
    >>> samples = Samples(place, np.ones((8, 3)), np.full(8, 0.5), np.eye(3))
    >>> Resampler()(samples, Camera.from_fov(60, 24, 32), height=24, width=32)
    Frame(32 × 24 px, 57.2 % covered, depth from 4.072)
    """

    position: Floats  # (N, 3) scene units
    color: Floats  # (N, 3) linear light, not multiplied by the opacity
    extinction: Floats  # (N,) optical depth per scene unit; samples of 0 are skipped
    lattice: Doubles  # (3, 3) columns are the steps from a sample to its neighbours, scene units
    scale: Floats | None = None  # (N,) scale factors of the ellipsoids; None: 1


class Lamp(NamedTuple):
    """A distant white light and the coefficients of Blinn-Phong shading."""

    toward: Doubles  # (3,) unit vector to the light, scene axes; zero: the light is at the viewer
    viewer: Doubles  # (4,) position and 1, or unit vector to the viewer and 0; scene axes
    ambient: float
    diffuse: float
    specular: float
    shininess: float
    flat: float  # data units per scene unit; there is no surface up to this gradient


class Classifier(NamedTuple):
    """Colors of a field's values, a table of G gradients by K values, evenly spaced."""

    table: Floats  # (G, K, 4) straight linear RGB, and optical depth per scene unit
    low: float  # data units, the value of the first column
    high: float  # data units, the value of the last column, above `low`
    steep: float  # data units per scene unit, the last row's gradient; the first row's is 0
    lamp: Lamp
    near: float  # z-depth, scene units, where depth cueing begins
    far: float  # z-depth, scene units, where it ends, above `near`
    dimmed: float  # fraction of the light that is lost at `far`, 0..1


Coefficients = NDArray[np.uint16] | Floats
Flags = NDArray[np.uint8]


class Bounds(NamedTuple):
    """Minimum and maximum in each brick of a field, z slowest."""

    least: Floats | Doubles  # (z, y, x)
    greatest: Floats | Doubles  # (z, y, x)


class SplineField(NamedTuple):
    """A scalar field on a lattice as cubic B-spline coefficients.

    They extend two samples beyond each side; see `resample.engine.rays.coefficients`.
    """

    coefficient: Coefficients  # (N,) z slowest; value = zero + scale × Σ coefficient × weight
    row: int  # coefficients from one row to the next
    plane: int  # coefficients from one plane to the next
    scale: float  # data units
    zero: float  # data units
    shape: tuple[int, int, int]  # samples along z, y and x
    floor: float  # data units, the smallest sample; lower bound of extremes and means
    ceiling: float  # data units, the largest sample; upper bound


class Reached(NamedTuple):
    """Transmittance of light on its way to the cells of a grid."""

    share: Flags  # (Z, Y, X, 2) of the lamp's light and of ambient light; 255 is all
    per: int  # samples along each side of a cell; the first begins at the first sample


UNBLOCKED = Reached(np.zeros((0, 0, 0, 2), np.uint8), 1)  # no occlusion


class Triangles(NamedTuple):
    """Triangles in a scene, in a tree of boxes; see `resample.painting.meshes.mesh_of`."""

    corner: Doubles  # (V, 3) scene units
    normal: Doubles  # (V, 3) unit vectors
    color: Doubles  # (V, 3) straight linear RGB
    face: Indices  # (T, 3) corners, in the order of the tree's leaves
    opacity: Doubles  # (T,) 0..1
    box: Doubles  # (2 L, 6) minimum and maximum x, y, z; children of 1 are 2 and 3, and so on


_NONE = np.zeros((0, 3))
NO_TRIANGLES = Triangles(
    _NONE, _NONE, _NONE, np.zeros((0, 3), np.int64), np.zeros(0), np.zeros((0, 6))
)


class Tint(NamedTuple):
    """Own colors of samples."""

    color: NDArray[np.uint16]  # (N, 3) as the coefficients; (0, 3): colors of the classifier
    most: float  # linear light that 65535 stands for


UNTINTED = Tint(np.zeros((0, 3), np.uint16), 1.0)


UNKNOWN = np.zeros((0, 0, 0), np.uint64)  # cells of a field, not yet examined
UNMEASURED = np.zeros((0, 0, 0), np.uint8)  # distances in a field, not yet known


class BlockLevels(NamedTuple):
    """Upper bounds of a field, or of its negated values, in blocks of cells, as 8 bits."""

    leaf: Flags  # (z, y, x) levels of small blocks; or (0, 0, 0)
    block: Flags  # (z, y, x) of blocks of them, of 2^BLOCK cells a side (`engine.rays.extremes`)
    shift: int  # a small block has 2^shift cells a side
    low: float  # data units, of level 0; negative of it for negated values
    per_value: float  # levels per data unit


_NO_BLOCKS = np.zeros((0, 0, 0), np.uint8)
UNBOUNDED = BlockLevels(_NO_BLOCKS, _NO_BLOCKS, 0, 0.0, 1.0)


class LatticeField(NamedTuple):
    """A scalar field of samples on a lattice; it is classified along rays."""

    spline: SplineField
    bounds: Bounds  # data units
    known: Flags  # (N,) as the coefficients: number of a look from 1 on, 0: missing; or (0,)
    lattice: Doubles  # (3, 3) columns are the steps from a sample to its neighbours, scene units
    origin: Doubles  # (3,) scene position of the first sample
    classifier: Classifier
    reached: Reached = UNBLOCKED
    mesh: Triangles = NO_TRIANGLES  # meshes in the field
    classifiers: int = 1  # number of looks side by side in the rows of the classifier's table
    tint: Tint = UNTINTED
    cells: NDArray[np.uint64] = UNKNOWN  # (z, y, x) as `painting.rays.visible_cells` finds them
    apart: Flags = UNMEASURED  # (z, y, x) bricks from each to the next that has such cells
    levels: BlockLevels = UNBOUNDED  # of extremes, within the samples around a place


class View(NamedTuple):
    """A camera in the form that kernels use."""

    rotation: Doubles  # (3, 3) world to camera
    translation: Doubles  # (3,) scene units
    focal: Doubles  # (2,) fx, fy in px; px per scene unit where parallel
    principal: Doubles  # (2,) cx, cy in px
    near: float  # scene units; the near plane
    perspective: bool
    far: float = math.inf  # scene units; the far plane, for fields only


class Ellipsoid(NamedTuple):
    """The reconstruction ellipsoid around every sample, in camera axes."""

    to_unit: Doubles  # (3, 3) maps it to the unit sphere
    pixel_to_unit: Doubles  # (3, 2) maps px at depth 1, or px where parallel, into that space
    from_unit: Doubles  # (3, 3) the inverse
    covariance: Doubles  # (3, 3) from_unit from_unitᵀ; its diagonal holds the squared half extents
    volume: float  # scene units³ that one sample stands for
    scale: float  # factor of unit line integrals, 1 / radius³ in voxels
    radius: float  # voxels


class Screen(NamedTuple):
    """Size of the picture, what matters around it, and clipping planes."""

    width: int  # px
    height: int  # px
    margin: float = 0.0  # px around it within which samples still matter
    planes: Doubles = (
        NO_PLANES  # (M, 5) unit normal and offset, camera axes: 0 and more is kept; half extent
    )


class Layers(NamedTuple):
    """Numbers of a compositing order from which kernels compute each sample's layer.

    A sample's place is axis · position + offset, or its distance from the eye. Samples are painted
    in ascending order of their place, or of its distance from the eye's place; samples of one layer
    may be summed before they are composited.
    """

    axis: tuple[float, float, float]  # places per scene unit, along the scene's axes
    offset: float  # place of the scene's origin
    thickness: float  # of a layer, in places; a layer begins at place 0
    eye: float = -math.inf  # place of the eye, between samples; -inf: all lie behind it
    is_around: bool = False  # the place is the distance from the eye, and there is no axis
    begins_at_first: bool = False  # the sample of smallest place lies in the middle of its layer


class Sheets(NamedTuple):
    """Painting order of samples, and the sheets that are summed before compositing."""

    key: Floats  # (N,) samples are painted in ascending order of it
    sheet: NDArray[np.int32]  # (N,) consecutive samples of the same sheet may be summed


class RadialTable(NamedTuple):
    """A radial function, tabulated at equal steps of its argument from 0 to `extent`."""

    values: Floats  # (K + 1,) the last entry is the value at `extent`
    extent: float  # px for pixel filters; 1 for footprints, with the squared index as argument


class Profile(NamedTuple):
    """A kernel's line integrals as a function of t = 1 - squared distance: sqrt(t) × polynomial."""

    p0: Single
    p1: Single
    p2: Single
    p3: Single
    p4: Single
    p5: Single
    p6: Single
    p7: Single
    p8: Single


Ten = tuple[Single, Single, Single, Single, Single, Single, Single, Single, Single, Single]


class Pieces(NamedTuple):
    """A kernel's line integrals at distance d: sqrt(1 - d²) times two polynomials.

    Each covers half of 0..1, in powers of the distance from the half's middle.
    """

    near: Ten
    far: Ten


class Tabulated(NamedTuple):
    """A kernel's line integrals as a table, where no formula fits."""

    values: Floats  # (K + 1,) over the squared distance, 0..1


class Tables(NamedTuple):
    """The pixel filter of a rendering."""

    pixel: Floats  # (K + 1,) 1-D profile of the filter that resolves sub-pixels to pixels
    pixel_extent: float  # px at which it ends
    pixel_margin: int  # px around a pixel that the filter reads


class Style(NamedTuple):
    """Choices that a painter reads as numbers."""

    subpixels: int  # per side of a pixel; 0: as many as samples need
    projection: int  # COMPOSITE, MAXIMUM, AVERAGE, ADDITIVE, FIRST_HIT, MINIMUM or ATTENUATED
    attenuation: float  # per voxel of the classifier's highest value, of ATTENUATED
    iso: float  # position of the first hit's value between the classifier's low and high, 0..1
    linear_opacity: bool  # classic α × F instead of 1 - exp(-τ F)
    layer: float  # scene units, thickness of the layer that a sheet of points stands for
    tint: tuple[float, float, float]  # color of splats; negative: their own


class Stage(NamedTuple):
    """Data shared by all samples that are placed on a screen."""

    camera: View
    ellipsoid: Ellipsoid
    screen: Screen


class Tiles(NamedTuple):
    """Which samples touch which tile of the screen (compressed rows)."""

    start: NDArray[np.int64]  # (T + 1,) where the members of tile t begin
    member: NDArray[np.int32]  # (M,) sample
    spacing: Floats  # (T,) smallest spacing of a member, px
    size: int  # px, side of a tile
    columns: int  # tiles in a row of them


class Film(NamedTuple):
    """A picture while it is painted; see `Frame`."""

    rgba: Floats  # (H, W, 4)
    depth: Floats  # (H, W)
    first_depth: Floats  # (H, W)
    coverage: Floats  # (H, W)


class Statistics(NamedTuple):
    """Counts and times of a rendering."""

    samples: int
    points: int  # samples painted as points
    splats: int  # samples painted as splats
    hidden: int  # points and splats skipped because every pixel was already opaque
    subpixels: int  # finest sub-pixel grid of any tile, per side
    seconds: dict[str, float]  # per stage
    is_preview: bool = False  # whether the picture shows only some of the samples
    rays: int = 0  # upper bound on rays through a field: one per sub-pixel that may see it
    from_table: int = 0  # splats with an index from the paper's correction table
    by_equation: int = 0  # splats beyond the table, with an index from its equation

    @property
    def splat_fraction(self) -> float:
        """Fraction of the painted samples that were splats."""
        return self.splats / max(1, self.points + self.splats)


if TYPE_CHECKING:  # what a plain `Frame` counts; Python itself knows no defaults before 3.13
    from typing_extensions import TypeVar

    Counts = TypeVar("Counts", default=Statistics)
else:
    from typing import TypeVar

    Counts = TypeVar("Counts")


class _Frame(NamedTuple, Generic[Counts]):
    """Fields of `Frame`."""

    rgba: Floats  # (H, W, 4) premultiplied, linear light
    depth: Floats  # (H, W) visibility-weighted z-depth, scene units; inf where empty
    first_depth: Floats  # (H, W) z-depth of the nearest visible sample; inf where empty
    coverage: Floats  # (H, W) fraction of the pixel that is covered, however faintly, 0..1
    statistics: Counts  # counts and times of the rendering
    value: Floats | None = None  # (H, W) measurement of a projected field; see `Projection`


class Frame(Showable, _Frame[Counts]):
    """A rendered scene (volume, cloud, mesh, samples) with data on each pixel.

    The color is premultiplied by its opacity, the fourth channel. Warped pictures, of any channels
    and types, are an application's `Warped` instead; its `image` is multiplied by its `coverage`.
    Both use the names `coverage` and `depth`.

    Examples
    --------
    >>> from resample import Camera, Resampler, particles
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> frame = Resampler()(particles([[0, 0, 5]], (1, 0, 0), 0.9, 1), camera, height=24, width=32)
    >>> frame
    Frame(32 × 24 px, 6.77 % covered, depth from 4.838)
    >>> frame.rgba.shape, frame.to_uint8("depth").shape
    ((24, 32, 4), (24, 32, 3))
    >>> round(float(frame.first_depth[12, 16]), 1)  # of the first splat's center
    5.0
    """

    __slots__ = ()

    def over(self, background: Behind) -> "Frame[Counts]":
        """Return the frame over a uniform background, as in `save`: its opacity is 1 throughout."""
        made: Frame[Counts] = results().composited(self, background)
        return made
