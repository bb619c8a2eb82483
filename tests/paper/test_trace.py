"""What `--method paper` runs: the same modules in all three applications, and nothing else."""

import sys

import numpy as np
import pytest

import resample.engine.jit
from resample import Camera, Footprint, Resampler, Samples
from resample.engine.compiled import digests
from resample.hybrid.blend import NearestSurface, OverBlend, WeightedSum
from resample.hybrid.splats import LookupTables
from resample_texture import warp as warp_texture
from resample_warp3d import warp as warp_depth

CORE = {
    f"resample.hybrid.{name}"
    for name in [
        "record",
        "classify",
        "footprint",
        "correction",
        "points",
        "splats",
        "occlusion",
        "paint",
    ]
}
PAINTERS = [
    "cells",
    "ellipsoids",
    "points",
    "rays",
    "slabs",
    "surfaces",
    "windows",
]  # of the engine
COUNTED = ("from_table", "by_equation")


def volume():
    rng = np.random.default_rng(1)
    place = rng.uniform(-3, 3, (200, 3)).astype(np.float32)
    samples = Samples(place, np.full((200, 3), 0.5), np.full(200, 0.7), np.eye(3))
    camera = Camera.from_intrinsics(30.0, 30.0, 16.0, 16.0, np.c_[np.eye(3), [0, 0, 12.0]])
    return Resampler(method="paper")(samples, camera, height=32, width=32)


def texture():
    return warp_texture(np.ones((16, 16, 3)), np.diag([1.5, 0.4, 1.0]), (20, 30), method="paper")


def depth_image():
    camera = Camera.from_fov(60, 24, 32)
    ahead = camera.moved(np.c_[np.eye(3), [0, 0, -0.5]])
    return warp_depth(np.ones((24, 32, 3)), np.full((24, 32), 2.0), camera, ahead, "paper")


APPLICATIONS = {
    "volume": (volume, OverBlend, "resample.hybrid.voxels"),
    "texture": (texture, WeightedSum, "resample_texture.methods.paper"),
    "warp3d": (depth_image, NearestSurface, "resample_warp3d.methods.kernels.placing"),
}


def kernels_called(run):
    """Parallel kernels that Python calls."""
    kernels = set()

    def note(frame, event, _):
        code = frame.f_code
        is_kernel = code.co_name == "call" and code.co_filename == resample.engine.jit.__file__
        if event == "call" and is_kernel and "compiled" in frame.f_locals:
            kernels.add(frame.f_locals["compiled"])

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return kernels


@pytest.mark.parametrize("name", APPLICATIONS)
def test_all_applications_pass_through_the_same_modules(name):
    run, blend, adapter = APPLICATIONS[name]
    called = {each.__module__: each for each in kernels_called(run)}
    assert {"resample.hybrid.paint", adapter} <= called.keys()
    painters = {f"resample.engine.{painter}" for painter in PAINTERS}
    assert not {each for each in called if {each, each.rpartition(".")[0]} & painters}
    compiled = [called[module] for module in ("resample.hybrid.paint", adapter)]
    parts = {
        part for each in compiled for part in digests.made_from(each, [blend, LookupTables])[1]
    }
    modules = {part.rpartition(".")[0] for part in parts}
    assert modules >= CORE
    assert blend.__module__ in modules
    assert ("resample.hybrid.ellipse" in modules) == (name == "volume")


def test_the_index_correction_table_is_read(monkeypatch):
    before = volume()
    assert before.statistics.from_table > 0
    flat = LookupTables._field_defaults["correction"] * np.float32(0.5)
    monkeypatch.setitem(LookupTables._field_defaults, "correction", flat)
    monkeypatch.setattr(
        LookupTables.__new__, "__defaults__", (flat, LookupTables._field_defaults["largest"])
    )
    assert np.abs(volume().rgba - before.rgba).max() > 0.01


def test_statistics_tell_how_many_indices_came_from_the_table():
    counted = volume().statistics
    assert [getattr(counted, name) for name in COUNTED] == [counted.splats, 0]


def test_names_of_methods_are_those_of_primitives():
    assert Resampler(method="paper", footprint=Footprint.EQUATION).primitive == "paper"
    with pytest.raises(ValueError, match="method 'papr'; known: hybrid, points, splats, paper"):
        Resampler(method="papr")
