"""`import resample_dropins.opencv as cv2`: names and forms of calls of public scripts."""

import runpy
import subprocess
import sys
import types

import cv2
import numpy as np
import pytest
import scipy.ndimage

from resample_dropins import ndimage, opencv, scikit

# Repository and file: the names of cv2 that it uses.
NAMES = """\
aleju/imgaug/imgaug/augmenters/geometric.py:
BORDER_CONSTANT BORDER_REFLECT BORDER_REFLECT_101 BORDER_REPLICATE BORDER_WRAP CV_16SC2
INTER_CUBIC INTER_LANCZOS4 INTER_LINEAR INTER_NEAREST WARP_FILL_OUTLIERS WARP_INVERSE_MAP
WARP_POLAR_LINEAR WARP_POLAR_LOG blur cartToPolar convertMaps getPerspectiveTransform
perspectiveTransform remap warpAffine warpPerspective warpPolar

albumentations-team/albumentations/albumentations/augmentations/geometric/functional.py:
BORDER_CONSTANT BORDER_DEFAULT BORDER_REFLECT BORDER_REFLECT101 BORDER_REFLECT_101
BORDER_REPLICATE BORDER_WRAP CV_32FC1 DECOMP_LU GaussianBlur INTER_NEAREST circle
connectedComponents copyMakeBorder copyTo dilate erode fillConvexPoly gemm
getPerspectiveTransform initUndistortRectifyMap log merge multiply perspectiveTransform remap
resize solve transform warpAffine warpPerspective

albumentations-team/albumentations/albumentations/augmentations/pixel/functional.py:
BORDER_CONSTANT BORDER_REPLICATE COLOR_GRAY2RGB COLOR_HLS2RGB COLOR_HSV2RGB COLOR_LAB2RGB
COLOR_RGB2GRAY COLOR_RGB2HLS COLOR_RGB2HSV COLOR_RGB2LAB COLOR_RGB2YCrCb COLOR_YCrCb2RGB
COVAR_NORMAL COVAR_ROWS COVAR_SCALE CV_32F CV_32FC1 CV_8U Canny DIST_L2 DIST_MASK_PRECISE
GaussianBlur IMREAD_GRAYSCALE IMREAD_UNCHANGED IMWRITE_JPEG_QUALITY IMWRITE_WEBP_QUALITY
INTER_LINEAR LINE_4 NORM_MINMAX THRESH_TRUNC add addWeighted blur calcCovarMatrix calcHist
circle createCLAHE cvtColor distanceTransform eigen equalizeHist exp fillPoly filter2D gemm
imdecode imencode initUndistortRectifyMap line meanStdDev merge mixChannels multiply normalize
polylines pow randn remap resize sepFilter2D setRNGSeed split subtract threshold transform

amdegroot/ssd.pytorch/utils/augmentations.py:
COLOR_BGR2HSV COLOR_HSV2BGR cvtColor resize

biubug6/Pytorch_Retinaface/data/data_augment.py:
COLOR_BGR2HSV COLOR_HSV2BGR INTER_AREA INTER_CUBIC INTER_LANCZOS4 INTER_LINEAR INTER_NEAREST
cvtColor resize

biubug6/Pytorch_Retinaface/test_widerface.py:
FONT_HERSHEY_DUPLEX IMREAD_COLOR INTER_LINEAR circle imread imwrite putText rectangle resize

deepinsight/insightface/python-package/insightface/utils/face_align.py:
resize warpAffine

JaidedAI/EasyOCR/easyocr/craft_utils.py:
CC_STAT_AREA CC_STAT_HEIGHT CC_STAT_LEFT CC_STAT_TOP CC_STAT_WIDTH INTER_NEAREST MORPH_RECT
boxPoints connectedComponentsWithStats dilate getPerspectiveTransform getStructuringElement line
minAreaRect threshold warpPerspective

JaidedAI/EasyOCR/easyocr/utils.py:
COLOR_BGR2GRAY COLOR_BGR2RGB COLOR_GRAY2BGR COLOR_RGB2BGR IMREAD_COLOR IMREAD_GRAYSCALE cvtColor
getPerspectiveTransform imdecode imread resize warpPerspective

JaidedAI/EasyOCR/trainer/craft/data/imgaug.py:
INTER_CUBIC INTER_NEAREST getRotationMatrix2D resize warpAffine

leoxiaobin/deep-high-resolution-net.pytorch/lib/dataset/JointsDataset.py:
COLOR_BGR2RGB IMREAD_COLOR IMREAD_IGNORE_ORIENTATION INTER_LINEAR cvtColor imread warpAffine

leoxiaobin/deep-high-resolution-net.pytorch/lib/utils/transforms.py:
INTER_LINEAR getAffineTransform warpAffine

ndrplz/self-driving-car/project_4_advanced_lane_finding/calibration_utils.py:
COLOR_BGR2GRAY COLOR_BGR2RGB calibrateCamera cvtColor destroyAllWindows drawChessboardCorners
findChessboardCorners imread imshow imwrite undistort waitKey

ndrplz/self-driving-car/project_4_advanced_lane_finding/perspective_utils.py:
COLOR_BGR2RGB INTER_LINEAR cvtColor getPerspectiveTransform imread warpPerspective

open-mmlab/mmcv/mmcv/image/geometric.py:
BORDER_CONSTANT BORDER_ISOLATED BORDER_REFLECT BORDER_REFLECT_101 BORDER_REPLICATE
BORDER_TRANSPARENT BORDER_WRAP INTER_AREA INTER_CUBIC INTER_LANCZOS4 INTER_LINEAR INTER_NEAREST
copyMakeBorder flip getRotationMatrix2D resize warpAffine

PyImageSearch/imutils/imutils/convenience.py:
COLOR_BGR2RGB Canny IMREAD_COLOR INTER_AREA MORPH_RECT addWeighted bitwise_or countNonZero
cvtColor dilate erode getRotationMatrix2D getStructuringElement imdecode resize subtract
warpAffine

PyImageSearch/imutils/imutils/face_utils/facealigner.py:
INTER_CUBIC getRotationMatrix2D warpAffine

PyImageSearch/imutils/imutils/perspective.py:
getPerspectiveTransform warpPerspective

ultralytics/yolov5/utils/augmentations.py:
BORDER_CONSTANT COLOR_BGR2HSV COLOR_HSV2BGR FILLED INTER_LINEAR LUT copyMakeBorder cvtColor
drawContours flip getRotationMatrix2D merge resize split warpAffine warpPerspective

ultralytics/yolov5/utils/dataloaders.py:
CAP_PROP_FPS CAP_PROP_FRAME_COUNT CAP_PROP_FRAME_HEIGHT CAP_PROP_FRAME_WIDTH
CAP_PROP_ORIENTATION_META COLOR_BGR2RGB INTER_AREA INTER_CUBIC INTER_LANCZOS4 INTER_LINEAR
INTER_NEAREST ROTATE_180 ROTATE_90_CLOCKWISE ROTATE_90_COUNTERCLOCKWISE VideoCapture cvtColor
destroyAllWindows imread resize rotate waitKey

xinntao/facexlib/facexlib/utils/face_restoration_helper.py:
BORDER_CONSTANT BORDER_REFLECT BORDER_REFLECT101 COLOR_GRAY2BGR GaussianBlur INTER_LANCZOS4
INTER_LINEAR LMEDS boxFilter cvtColor erode estimateAffinePartial2D imread invertAffineTransform
resize warpAffine
"""
SCRIPTS = dict(entry.split(":") for entry in NAMES.split("\n\n"))
CALLS = [  # of these scripts: a call, how many arguments go by place, and those by name
    ("remap", 3, "interpolation borderMode"),
    ("remap", 3, "interpolation borderMode borderValue"),
    ("remap", 4, ""),
    ("remap", 4, "borderMode borderValue"),
    ("resize", 1, "dsize fx fy"),
    ("resize", 1, "dsize fx fy interpolation"),
    ("resize", 2, ""),
    ("resize", 2, "dst interpolation"),
    ("resize", 2, "fx fy interpolation"),
    ("resize", 2, "interpolation"),
    ("resize", 3, "fx fy interpolation"),
    ("undistort", 3, "newCameraMatrix"),
    ("warpAffine", 1, "M dsize flags"),
    ("warpAffine", 2, "dsize borderValue"),
    ("warpAffine", 2, "dsize flags borderMode borderValue"),
    ("warpAffine", 3, ""),
    ("warpAffine", 3, "borderMode borderValue"),
    ("warpAffine", 3, "borderValue"),
    ("warpAffine", 3, "borderValue flags"),
    ("warpAffine", 3, "flags"),
    ("warpAffine", 3, "flags borderMode borderValue"),
    ("warpPerspective", 2, "dsize borderValue"),
    ("warpPerspective", 3, ""),
    ("warpPerspective", 3, "borderValue borderMode"),
    ("warpPerspective", 3, "borderValue borderMode flags"),
    ("warpPerspective", 3, "flags"),
    ("warpPolar", 5, ""),
]
OWN = {"linearPolar", "logPolar", "remap", "resize", "warpAffine", "warpPerspective", "warpPolar"}
IMAGE = np.random.default_rng(7).integers(0, 256, (40, 50, 3)).astype(np.uint8)
TURN = cv2.getRotationMatrix2D((25, 20), 7, 1.1)
Y, X = np.mgrid[:40, :50].astype(np.float32)
# Arguments by name, of which some differ between calls, and the order of those by place.
GIVEN = {
    "src": IMAGE, "dsize": (60, 50), "dst": None, "fx": 1.25, "fy": 1.5, "flags": cv2.INTER_CUBIC,
    "interpolation": cv2.INTER_LANCZOS4, "borderMode": cv2.BORDER_REFLECT_101,
    "borderValue": (114, 114, 114), "map1": 0.9 * X, "map2": 0.8 * Y, "center": (25.0, 20.0),
    "maxRadius": 20.0, "cameraMatrix": np.array([[60.0, 0, 25], [0, 60, 20], [0, 0, 1]]),
    "distCoeffs": np.array([0.1, -0.05, 0, 0, 0]), "newCameraMatrix": np.diag([50.0, 50.0, 1.0]),
}  # fmt: skip
PLACES = {
    "remap": "src map1 map2 interpolation",
    "resize": "src dsize dst",
    "undistort": "src cameraMatrix distCoeffs",
    "warpAffine": "src M dsize",
    "warpPerspective": "src M dsize",
    "warpPolar": "src dsize center maxRadius flags",
}


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_s_names_are_opencv_s(script):
    for name in SCRIPTS[script].split():
        if name in OWN:
            assert callable(getattr(opencv, name))
        else:
            assert getattr(opencv, name) is getattr(cv2, name)


@pytest.mark.parametrize(("name", "count", "named"), CALLS)
def test_a_script_s_calls_are_opencv_s(name, count, named):
    given = {**GIVEN, "M": np.vstack([TURN, [0, 0, 1]]) if name == "warpPerspective" else TURN}
    if name == "resize" and "fx" in named:
        given["dsize"] = None
    if name == "warpPolar":  # so many angles that no pixel shrinks
        given |= {"dsize": (60, 200), "flags": cv2.INTER_CUBIC | cv2.WARP_FILL_OUTLIERS}
    places = [given[argument] for argument in PLACES[name].split()[:count]]
    choices = {argument: given[argument] for argument in named.split()}
    ours, theirs = (getattr(module, name)(*places, **choices) for module in (opencv, cv2))
    assert ours.dtype == theirs.dtype
    np.testing.assert_array_equal(ours, theirs)


def all_names_of(module, folder):
    """What a script has after `from module import *`."""
    script = folder / "script.py"
    script.write_text(f"from {module.__name__} import *\n")
    return runpy.run_path(str(script))


def test_a_module_in_place_of_cv2_is_found_by_all_forms_of_import(tmp_path):
    found = all_names_of(opencv, tmp_path)
    assert found["imread"] is cv2.imread
    assert found["warpAffine"] is opencv.warpAffine
    assert {name for name in dir(cv2) if name[0] != "_"} <= {*dir(opencv)} & {*opencv.__all__}
    assert opencv.__version__ == cv2.__version__
    assert opencv.aruco is cv2.aruco
    assert not hasattr(opencv, "no_such_name")
    assert not hasattr(opencv, "__path__")


def test_scipy_s_names_are_scipy_s(tmp_path):
    found = all_names_of(ndimage, tmp_path)
    assert found["gaussian_filter"] is scipy.ndimage.gaussian_filter
    assert found["zoom"] is ndimage.zoom
    assert {*scipy.ndimage.__all__} <= {*dir(ndimage)}
    assert not hasattr(ndimage, "no_such_name")


def test_scikit_image_s_names_are_its_own_if_it_is_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage", None)
    monkeypatch.setitem(sys.modules, "skimage.transform", None)
    with pytest.raises(AttributeError, match="pip install scikit-image"):
        _ = scikit.AffineTransform
    package, transform = types.ModuleType("skimage"), types.ModuleType("skimage.transform")
    package.transform = transform  # type: ignore[attr-defined]
    transform.AffineTransform = object()  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "skimage", package)
    monkeypatch.setitem(sys.modules, "skimage.transform", transform)
    assert scikit.AffineTransform is transform.AffineTransform
    assert {*scikit.__all__} == {"rescale", "resize", "rotate", "warp"}


def test_what_opencv_draws_alone_loads_no_kernels():
    text = (
        "import sys, numpy as np, resample_dropins.opencv as cv2;"
        "image = np.zeros((50, 60, 3), np.uint8);"
        "cv2.warpAffine(image, np.eye(2, 3), (70, 80)); cv2.resize(image, (90, 90));"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
