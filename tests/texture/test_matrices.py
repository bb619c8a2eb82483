import math

import numpy as np
import pytest

from resample_texture.geometry.mappings import source_coordinates
from resample_texture.geometry.matrices import Convention, homography, parse_matrix, rectified_shape

NINE = np.array([[1.5, 0.25, 3], [-0.5, 2, 4], [0.001, 0, 1]])
SIX = np.array([[1.5, 0.25, 3], [-0.5, 2, 4], [0, 0, 1]])


def moved(matrix, points):
    """Points (N, 2) after a homography."""
    full = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return full[:, :2] / full[:, 2:]


def random_matrix(seed):
    rng = np.random.default_rng(seed)
    return np.eye(3) + rng.uniform(-1, 1, (3, 3)) * [[0.3, 0.3, 5], [0.3, 0.3, 5], [2e-3, 2e-3, 0]]


# Conventions.


@pytest.mark.parametrize("seed", range(5))
def test_opencv_s_matrix_moves_pixel_centers_as_opencv_does(seed):
    cv2 = pytest.importorskip("cv2")
    matrix = random_matrix(seed)
    pixels = np.random.default_rng(seed).integers(0, 50, (20, 2)).astype(float)
    expected = cv2.perspectiveTransform(pixels[None], matrix)[0]
    found = moved(homography(matrix, convention="opencv").matrix, pixels + 0.5)
    np.testing.assert_allclose(found, expected + 0.5, rtol=1e-10)


def test_a_lone_pixel_lands_where_opencv_puts_it():
    cv2 = pytest.importorskip("cv2")
    picture = np.zeros((8, 8), np.float32)
    picture[3, 5] = 1
    double = np.diag([2.0, 2.0, 1.0])
    warped = cv2.warpPerspective(picture, double, (16, 16), flags=cv2.INTER_LINEAR)
    row, column = np.unravel_index(np.argmax(warped), warped.shape)
    found = moved(homography(double, convention=Convention.OPENCV).matrix, np.array([[5.5, 3.5]]))
    np.testing.assert_allclose(found, [[column + 0.5, row + 0.5]], atol=1e-12)


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_pixels_see_what_warp_perspective_sees(seed, inverse):
    cv2 = pytest.importorskip("cv2")
    matrix = random_matrix(seed)
    ramp = np.ascontiguousarray(np.mgrid[0:64, 0:64][1], np.float32)  # its value is the column
    flags = cv2.INTER_LINEAR | (cv2.WARP_INVERSE_MAP if inverse else 0)
    seen = cv2.warpPerspective(ramp, matrix, (24, 20), flags=flags, borderValue=-1e6)
    geometry = homography(matrix, convention="opencv", inverse=inverse)
    x, y = source_coordinates(geometry, (20, 24), (64, 64))
    is_inside = (np.minimum(x, y) > 0.6) & (np.maximum(x, y) < 63.4)
    assert is_inside.sum() > 100
    # OpenCV 4 rounds places to 1/32 px, OpenCV 5 computes in float32
    np.testing.assert_allclose(x[is_inside] - 0.5, seen[is_inside], atol=1 / 32)


@pytest.mark.parametrize("convention", list(Convention))
def test_whole_shifts_stay_exact(convention):
    shift = np.array([[1, 0, 37], [0, 1, -2048], [0, 0, 1]])
    np.testing.assert_array_equal(homography(shift, convention=convention).matrix, shift)
    np.testing.assert_array_equal(
        homography(shift, convention=convention, inverse=True).inverse(), shift
    )


def test_an_inverse_matrix_maps_the_target_to_the_source():
    np.testing.assert_allclose(homography(NINE, inverse=True).inverse(), NINE, atol=1e-12)


def test_two_lines_are_an_affine_map():
    np.testing.assert_array_equal(homography(SIX[:2]).matrix, SIX)


def test_whole_numbers_are_numbers():
    np.testing.assert_array_equal(homography([[1, 0, 2], [0, 1, 3]]).matrix[:, 2], [2, 3, 1])


@pytest.mark.parametrize(
    ("matrix", "complaint"),
    [
        (np.eye(4), r"\(4, 4\)"),
        (np.eye(2), r"\(2, 2\)"),
        (np.ones((3, 2)), r"\(3, 2\)"),
        (5.0, r"\(3, 3\)"),
        ([["a", "b", "c"]] * 3, "numbers"),
        (np.eye(3) * 1j, "numbers"),
        (np.zeros((3, 3)), "no inverse"),
        (np.diag([1, np.nan, 1]), "finite"),
    ],
)
@pytest.mark.parametrize("inverse", [False, True])
def test_what_is_no_matrix_is_refused(matrix, complaint, inverse):
    with pytest.raises(ValueError, match=complaint):
        homography(matrix, inverse=inverse)


def test_an_unknown_convention_names_the_known_ones():
    with pytest.raises(ValueError, match="unknown convention 'opengl'; known: corner, opencv"):
        homography(np.eye(3), convention="opengl")


# Matrices as they are written.


@pytest.mark.parametrize(
    "text",
    [
        "1.5,0.25,3,-0.5,2,4,0.001,0,1",
        "1.5 0.25 3  -0.5 2 4  1e-3 0 1",
        "1.5, 0.25, 3; -.5, 2, 4; 0.001, 0, 1",
        "[[1.5, 0.25, 3], [-0.5, 2, 4], [0.001, 0, 1]]",
        "1.5 0.25 3\n-0.5 2 4\n0.001 0 1\n",
    ],
)
def test_nine_numbers_are_a_matrix(text):
    np.testing.assert_array_equal(parse_matrix(text), NINE)


def test_six_numbers_are_an_affine_matrix():
    np.testing.assert_array_equal(parse_matrix("1.5,0.25,3,-0.5,2,4"), SIX)


@pytest.mark.parametrize(
    "content",
    [
        "1.5 0.25 3\n-0.5 2 4\n0.001 0 1\n",
        "\ufeff# calibrated\n\n1.5, 0.25, 3  # x\n-0.5, 2, 4\n0.001, 0, 1",
        "1.5 0.25 3 -0.5 2 4 0.001 0 1",
        "[[1.5 0.25 3.]\n [-0.5 2. 4.]\n [0.001 0. 1.]]",
    ],
)
def test_a_text_file_holds_a_matrix(tmp_path, content):
    path = tmp_path / "M.txt"
    path.write_text(content, encoding="utf-8")
    np.testing.assert_array_equal(parse_matrix(str(path)), NINE)


def test_a_text_file_of_two_lines_holds_an_affine_matrix(tmp_path):
    np.savetxt(tmp_path / "M.txt", SIX[:2])
    np.testing.assert_array_equal(parse_matrix(str(tmp_path / "M.txt")), SIX)


@pytest.mark.parametrize("matrix", [NINE, SIX[:2]])
def test_an_array_file_holds_a_matrix(tmp_path, matrix):
    np.save(tmp_path / "M.npy", matrix)
    np.testing.assert_array_equal(parse_matrix(str(tmp_path / "M.npy")), homography(matrix).matrix)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "0 numbers"),
        ("1,2,3", "3 numbers"),
        ("1,2,3,4,5,6,7,8,9,10", "10 numbers"),
        ("1,2,3,4,5,x,7,8,9", "may also be nine or six numbers"),
        ("no_such_file.txt", "no such file; a matrix may also be"),
    ],
)
def test_a_text_that_is_no_matrix_is_refused(text, complaint):
    with pytest.raises(ValueError, match=complaint):
        parse_matrix(text)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "no numbers in 0 lines"),
        (b"1 2 3\n4 5 6\n7 8\n", "3, 3, 2 numbers in 3 lines"),
        (b"1 2\n3 4\n5 6\n", "2, 2, 2 numbers"),
        (b"one two three\n", "not a text file of numbers"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "not a text file of numbers"),
        (b"1 " * 40000, "a file of nine numbers is smaller"),
    ],
)
def test_a_file_that_is_no_matrix_is_refused(tmp_path, content, complaint):
    path = tmp_path / "M.txt"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=complaint):
        parse_matrix(str(path))


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY\x01\x00garbage", b"not an array"])
def test_a_damaged_array_file_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "M.npy"
    path.write_bytes(content)
    with pytest.raises(OSError, match=r"M.npy holds no arrays that can be read: [^\n]+$"):
        parse_matrix(str(path))


def test_an_array_file_of_another_shape_is_refused(tmp_path):
    np.save(tmp_path / "M.npy", np.eye(4))
    with pytest.raises(ValueError, match=r"\(4, 4\)"):
        parse_matrix(str(tmp_path / "M.npy"))


def test_an_archive_of_arrays_is_no_matrix(tmp_path):
    np.savez(tmp_path / "M.npz", first=NINE, second=NINE)
    (tmp_path / "M.npz").rename(tmp_path / "M.npy")
    with pytest.raises(ValueError, match="the arrays first, second; give a file of one matrix"):
        parse_matrix(str(tmp_path / "M.npy"))


def test_a_folder_is_no_matrix(tmp_path):
    with pytest.raises(OSError, match="directory"):
        parse_matrix(str(tmp_path))


@pytest.mark.parametrize(
    ("width", "height", "shape"),
    [(20.4, 10.4, (10, 20)), (20.6, 10.6, (11, 21)), (20.9, 10.1, (10, 21)), (0.3, 0.2, (1, 1))],
)
def test_the_size_of_a_page_is_rounded_to_the_nearest_px_and_1_at_least(width, height, shape):
    page = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    assert rectified_shape(page) == shape


def test_the_size_of_a_page_is_the_mean_of_opposite_sides():
    page = [[2, 0], [22, 0], [24, 12], [0, 12]]  # 20 above, 24 below
    assert rectified_shape(page) == (round(math.hypot(2, 12)), 22)
