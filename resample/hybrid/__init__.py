"""The paper (Yuan, Nguyen, Xu, Chen 2003) as one small core, to be read beside it.

Each file is one idea, named after the paper's; read them in this order:

    record.py       what a sample is once it is on the screen
    classify.py     section 2     point or splat, by projected size; texels and depth pixels
    points.py       section 2     the circular filter at each pixel
    ellipse.py      appendix A    the screen ellipse: P, Q, R1, R2
    footprint.py    section 4.2   the kernel's line integrals F
    correction.py   section 4.2   the ray's distance d from the index i and the cone's angle alpha
    voxels.py       section 4     voxels on the screen, in the space where kernels are spheres
    splats.py       section 4.2   scan conversion of an ellipse
    roles.py        blending: what a pixel does with samples
    blend.py        sections 3, 4.1: sum | nearest surface | over
    occlusion.py    section 6     blocks of pixels that are opaque
    paint.py        one painter for all of it, tile by tile

An application turns its samples into records, in the order in which they are blended, hands them to
`paint` with a blend, and reads the picture from the blend. Pixel (row, column) has its center at
(column + 0.5, row + 0.5). The same in NumPy, a sample at a time, are `tests/paper/twin.py` and
`twin_volume.py`.
"""
