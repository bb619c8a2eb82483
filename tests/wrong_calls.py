"""Wrong calls of public functions, each of which mypy has to find.

`make lint` runs mypy on this file, where a call that it does not find is an unused `type: ignore`.
No test runs it. The names are typing errors of the kind that an editor underlines.
"""

import numpy as np

import resample
import resample_chunks
import resample_dropins.ndimage
import resample_dropins.scikit
import resample_particles
import resample_points
import resample_sky
import resample_texture
import resample_volume
import resample_warp3d

picture = np.zeros((4, 5))
cube = np.zeros((4, 5, 6))
camera = resample.Camera.from_fov(60, 4, 5)
one = np.zeros((1, 3))
few = resample_particles.Particles(one)
small = one.astype(np.float32)
cloud = resample_points.Cloud(small, small, small, small[:, 0])

# Core
resample.Camera.from_intrinsics(1, 1, 0, 0, convention="opncv")  # type: ignore[arg-type]
resample.Camera.from_opencv(np.eye(3), model="fish")  # type: ignore[arg-type]
resample.Orbit(30, 20, up="up")  # type: ignore[arg-type]
resample.orbit([0, 0, 0], 1, 30, 20, up="up")  # type: ignore[arg-type]
resample.Scatter("hybird")  # type: ignore[arg-type]
resample.Resampler()(resample.particles([[0, 0, 5]], (1, 0, 0), 0.9, 1), camera).to_uint8(  # type: ignore[call-arg]
    order="gbr"  # type: ignore[arg-type]
)
resample.Resampler(projection="max")  # type: ignore[arg-type]
resample.Resampler(footprint="afine")  # type: ignore[arg-type]
resample.Resampler(order=3)  # type: ignore[arg-type]
resample.Resampler(order="rays", opacity="exact", projection="maximum", pixel_filter="tent")
resample_volume.Appearance(classification="posts")  # type: ignore[arg-type]
resample_volume.Appearance(classification="post")

# Pictures
resample_texture.warp(picture, np.eye(3), (4, 5), edge="reflekt")  # type: ignore[arg-type]
resample_texture.warp(picture, np.eye(3), 4)  # type: ignore[arg-type]
resample_texture.warp(picture, np.eye(3), (4, 5), alpha="premul")  # type: ignore[arg-type]
resample_texture.warp(picture, np.eye(3), (4, 5), intrepolation="cubic")  # type: ignore[call-arg]
resample_texture.resize(picture, (4, 5), edge="reflekt")  # type: ignore[arg-type]
resample_texture.resize(picture, (4, 5), threads="2")  # type: ignore[arg-type]
resample_texture.rotate(picture, 30, convention="opencv")  # type: ignore[call-arg]
resample_texture.resize(picture, (4, 5), alpha="premul")  # type: ignore[arg-type]
resample_texture.rotate(picture, "30")  # type: ignore[arg-type]
resample_texture.scale(picture, 2, edge="reflekt")  # type: ignore[arg-type]
resample_chunks.warp_chunks(picture, np.eye(3), (4, 5), edge="reflekt")  # type: ignore[arg-type]
resample_texture.Plan(np.eye(3), (4, 5), (4, 5), edge="reflekt")  # type: ignore[arg-type]
resample_texture.PictureScene(picture).render(np.eye(3), edge="reflekt")  # type: ignore[arg-type]
resample_texture.PictureScene(picture).render(np.eye(3), quality="fast")  # type: ignore[arg-type]
resample_sky.coadd([picture], [np.eye(3)], (4, 5), interpolation="cubic")  # type: ignore[arg-type]
resample_texture.Hybrid(magnified="cell")  # type: ignore[arg-type]
resample_dropins.scikit.resize(picture, (4, 5), mode="mirror")  # type: ignore[arg-type]
resample_dropins.ndimage.zoom(picture, 2, mode="symmetric")  # type: ignore[arg-type]

# Depth images
resample_warp3d.warp(picture, picture, camera, camera, refine="snapp")  # type: ignore[arg-type]
resample_warp3d.warp(picture, picture, camera, camera, nois=0.1)  # type: ignore[call-arg]
resample_warp3d.warp(picture, picture, camera, camera, fill="pictures")  # type: ignore[arg-type]
resample_warp3d.warp_disparity(picture, picture, fill="pictures")  # type: ignore[arg-type]
resample_warp3d.DepthScene(picture, picture, camera).render(camera, size=4)  # type: ignore[arg-type]
resample_warp3d.Joining(blend="feather")  # type: ignore[arg-type]
resample_warp3d.merge([], "feather")  # type: ignore[arg-type]

# Points
resample_points.framed(cloud, size=(4, 5), up="up")  # type: ignore[arg-type]
resample_points.render_cloud(cloud, camera, size="4x5")  # type: ignore[arg-type]
resample_points.CloudStyle(light="head")  # type: ignore[arg-type]
resample_points.CloudScene(cloud).render("top", quality="fast")  # type: ignore[arg-type]
resample_points.GaussianStyle("train")  # type: ignore[arg-type]
resample_points.GaussianStyle(order="deep")  # type: ignore[arg-type]
resample_particles.column_density(few, "w", size=(4, 5))  # type: ignore[arg-type]
resample_particles.column_density(few, "z", size=(4, 5), kernel="cube")  # type: ignore[arg-type]

# Volumes
resample_volume.render(cube, size="400")  # type: ignore[arg-type]
resample_volume.Scene(cube).render("auto", quality="fast")  # type: ignore[arg-type]
resample_volume.Scene(cube).render("auto", fit="picture!")  # type: ignore[arg-type]
resample_volume.Appearance(gradient="sobl")  # type: ignore[arg-type]
resample_volume.Appearance(classification="late")  # type: ignore[arg-type]
