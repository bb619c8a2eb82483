"""Recordings of Record3D (.r3d): zip files of pictures, depth, confidence, and cameras."""

import zipfile
from pathlib import Path

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import from_opengl, from_quaternion
from resample.cameras.trajectories import Entry, Facts, PosedPicture, entry_of
from resample.messages import naming
from resample.reading.limits import check_member, check_unpacked
from resample.reading.texts import json_of
from resample.types import Doubles


def unpacked(path: Path, name: str) -> bytes:
    """Read a member of a recording: `metadata`, or `rgbd/0.jpg`, `.depth`, `.conf`."""
    try:
        with zipfile.ZipFile(path) as packed:
            member = packed.getinfo(name)
            check_member(str(path), member)
            check_unpacked(f"{path}: {name}", member.compress_size, member.file_size)
            return packed.read(member)
    except KeyError:
        raise LookupError(f"{path} has no {name}; it may have fewer frames") from None
    except (zipfile.BadZipFile, EOFError, RuntimeError) as error:  # or encrypted
        raise OSError(f"{path} is not a Record3D recording, or is damaged: {error}") from None


def facts_of_recording(path: Path) -> Facts:
    """Return a recording's metadata: sizes, intrinsics and poses."""
    with naming(str(path)):
        facts = json_of(unpacked(path, "metadata").decode("utf-8", "replace"))
    if not isinstance(facts, dict) or not {"K", "w", "h"} <= facts.keys():
        raise ValueError(f"{path} is not a Record3D recording: its metadata lack K, w or h")
    return facts


def read_record3d(path: Path) -> list[Entry]:
    """Read camera-to-world poses in OpenGL's axes (qx, qy, qz, qw, tx, ty, tz), and intrinsics."""
    facts = facts_of_recording(path)
    poses = facts.get("poses") or [[0, 0, 0, 1, 0, 0, 0]]

    def entry(name: str, given: list[float]) -> PosedPicture:
        numbers: Doubles = np.array(given, np.float64).reshape(7)
        back = np.eye(4)
        back[:3, :3], back[:3, 3] = from_quaternion(numbers[:4].tolist()), numbers[4:]
        matrix = np.array(facts["K"], np.float64).reshape(3, 3).T  # by columns
        pose = from_opengl(back)
        return PosedPicture(name, pose, Camera(matrix, pose), (int(facts["h"]), int(facts["w"])))

    return [
        entry_of(f"{path}: frame {n}", f"{n}.jpg", entry, f"{n}.jpg", given)
        for n, given in enumerate(poses)
    ]
