"""Small grids of cells of VTK, in XML and legacy files, in one piece and in two; OpenVDB."""

from typing import Any

import numpy as np

from tests.vdb_files import BALL, GRIDS


def grids() -> list[dict[str, bytes]]:
    """Files of each case, of which the first is read."""
    corners = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3)[:, ::-1]
    cube = np.array([0, 1, 4, 3, 9, 10, 13, 12])
    first = np.array([0, 1, 3, 4, 9, 10, 12, 13])
    points = _data_array("Float32", "", corners, 'NumberOfComponents="3"')
    values = f'<PointData Scalars="v">{_data_array("Float32", "v", np.arange(27))}</PointData>'
    rows = _grid_file(
        "StructuredGrid", 'WholeExtent="0 2 0 2 0 2"', 'Extent="0 2 0 2 0 2"', values, points
    )
    kinds = [
        _data_array("Int64", "connectivity", cube + first[:, np.newaxis]),
        _data_array("Int64", "offsets", 8 * np.arange(1, 9)),
        _data_array("UInt8", "types", np.full(8, 12)),
    ]
    sizes = 'NumberOfPoints="27" NumberOfCells="8"'
    any_shape = _grid_file(
        "UnstructuredGrid", "", sizes, values, points, f"<Cells>{''.join(kinds)}</Cells>"
    )
    blocks = (
        b'<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" '
        b'file="b.vts"/><DataSet index="1" file="c.vtu"/></vtkMultiBlockDataSet></VTKFile>'
    )
    listed = "\n".join(" ".join(map(str, (8, *row))) for row in cube + first[:, np.newaxis])
    legacy = (
        "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 27 float\n"
        f"{' '.join(map(str, corners.ravel()))}\nCELLS 8 72\n{listed}\nCELL_TYPES 8\n"
        f"{' '.join(['12'] * 8)}\nCELL_DATA 8\nSCALARS v int\n"
        "LOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n"
    )
    return [
        {"a.vts": rows},
        {"a.vtu": any_shape},
        {"a.vtm": blocks, "b.vts": rows, "c.vtu": any_shape},
        {"a.vtk": legacy.encode()},
        *({"a.vdb": content} for content in (GRIDS, BALL)),
    ]


def _data_array(kind: str, name: str, values: Any, more: str = "") -> str:
    listed = " ".join(map(str, np.asarray(values).ravel().tolist()))
    return f'<DataArray type="{kind}" Name="{name}" format="ascii" {more}>{listed}</DataArray>'


def _grid_file(
    kind: str, whole: str, sizes: str, values: str, points: str, rest: str = ""
) -> bytes:
    return (
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian"><{kind} {whole}>'
        f"<Piece {sizes}>{values}<Points>{points}</Points>{rest}</Piece></{kind}></VTKFile>"
    ).encode()
