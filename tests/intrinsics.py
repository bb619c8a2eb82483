"""Files of intrinsics, as other programs write them."""

import json
from pathlib import Path

import cv2
import numpy as np


def write_intrinsics(width: int = 32, height: int = 24) -> None:
    """20,20,16,12 as Open3D, ROS and OpenCV write it, with the first pixel's center at 0."""
    rows = [[20.0, 0, 15.5], [0, 20, 11.5], [0, 0, 1]]
    columns = np.transpose(rows).ravel().tolist()
    facts = {"width": width, "height": height, "intrinsic_matrix": columns}
    Path("open3d.json").write_text(json.dumps(facts))
    Path("ros.yaml").write_text(
        f"height: {height}\nwidth: {width}\ndistortion_model: plumb_bob\n"
        f"D: [0, 0, 0, 0, 0]\nK: {np.ravel(rows).tolist()}\n"
    )
    storage = cv2.FileStorage("opencv.yml", cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", np.array(rows))
    storage.release()
