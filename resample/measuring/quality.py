"""Image quality metrics: differences of a picture from its reference.

Pictures are (H, W, C) or (H, W). PSNR, RMS and the largest difference accept any values; SSIM and
FLIP model human vision and take display values: sRGB-encoded, 0..1.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[Any]

# FLIP's reference viewer: a 0.7 m wide display of 3840 px, seen from 0.7 m.
PIXELS_PER_DEGREE = 67.02

# Constants of structural similarity for values 0..255; they stabilise dark and uniform areas.
LIGHT, CONTRAST = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2


def measure(image: Picture, reference: Picture) -> dict[str, float]:
    """Compute all metrics.

    Parameters
    ----------
    image, reference
        (H, W, 3) sRGB-encoded, 0..1.

    Returns
    -------
    `psnr` in dB (inf for equal pictures), `ssim` (1 for equal ones), `flip`, `rms` and `largest`
    (0 for equal ones).

    Raises
    ------
    ValueError
        The shapes differ.
    """
    measures = {"psnr": psnr, "ssim": ssim, "flip": flip, "rms": rms, "largest": largest}
    return {name: function(image, reference) for name, function in measures.items()}


def psnr(a: Picture, b: Picture, peak: float = 1.0, mask: NDArray[np.bool_] | None = None) -> float:
    """Peak signal-to-noise ratio, dB; inf for equal pictures.

    `peak`: largest value that a picture can have. `mask`: (H, W) pixels to compare; None: all.
    """
    error = rms(a, b, mask)
    return math.inf if error == 0.0 else 20.0 * math.log10(peak / error)


def rms(a: Picture, b: Picture, mask: NDArray[np.bool_] | None = None) -> float:
    """Root mean squared difference over all values; `mask` as in `psnr`."""
    difference = _difference(a, b)
    if mask is not None:
        if mask.shape != a.shape[:2] or not mask.any():
            raise ValueError(f"a mask of {mask.shape} with {mask.sum()} pixels for {a.shape}")
        difference = difference[mask]
    return math.sqrt(float(np.mean(np.square(difference))))


def largest(a: Picture, b: Picture) -> float:
    """Largest absolute difference."""
    return float(np.abs(_difference(a, b)).max())


def ssim(a: Picture, b: Picture) -> float:
    """Structural similarity, 1 for equal pictures; the mean over the channels.

    Wang, Bovik, Sheikh and Simoncelli, Image Quality Assessment, 2004: Gaussian window of σ 1.5 px.
    """
    _check_shapes(a, b)
    one, two = (np.ascontiguousarray(picture, np.float32) * 255.0 for picture in (a, b))
    mean_one, mean_two = _windowed(one), _windowed(two)
    both, squares = mean_one * mean_two, mean_one**2 + mean_two**2
    covariance = _windowed(one * two) - both
    variances = _windowed(one**2) + _windowed(two**2) - squares
    like = (2.0 * both + LIGHT) * (2.0 * covariance + CONTRAST)
    return float(np.mean(like / ((squares + LIGHT) * (variances + CONTRAST)), dtype=np.float64))


def _windowed(picture: Any) -> Any:
    """Means under the window of structural similarity, with functions in all builds of OpenCV."""
    import cv2

    return cv2.GaussianBlur(picture, (11, 11), 1.5)


def flip(a: Picture, b: Picture) -> float:
    """Mean visible difference when alternating between two pictures; 0: no difference.

    Andersson et al., FLIP: A Difference Evaluator for Alternating Images, 2020 (the LDR variant).
    Gray pictures are treated as equal red, green and blue; further channels are ignored.
    """
    import OpenImageIO

    _check_shapes(a, b)
    result = OpenImageIO.ImageBufAlgo.FLIP_diff(
        _tagged(b), _tagged(a), hdr=0, ppd=PIXELS_PER_DEGREE
    )
    if result.has_error:
        raise ValueError(f"FLIP cannot be computed: {result.geterror().strip()}")
    return float(result.spec().get_float_attribute("FLIP:meanerror"))


def _tagged(picture: Picture) -> Any:
    """Three-channel buffer marked as sRGB-encoded; FLIP takes unmarked ones as linear."""
    import OpenImageIO

    rgb = picture.reshape(*picture.shape[:2], -1)[..., :3]
    rgb = rgb if rgb.shape[2] == 3 else np.repeat(rgb[..., :1], 3, axis=2)
    buffer = OpenImageIO.ImageBuf(np.ascontiguousarray(np.clip(rgb, 0.0, 1.0), np.float32))
    buffer.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    return buffer


def _difference(a: Picture, b: Picture) -> NDArray[np.float64]:
    _check_shapes(a, b)
    return np.subtract(a, b, dtype=np.float64)


def _check_shapes(a: Picture, b: Picture) -> None:
    if a.shape != b.shape:
        raise ValueError(f"a picture of {a.shape} cannot be compared with one of {b.shape}")
