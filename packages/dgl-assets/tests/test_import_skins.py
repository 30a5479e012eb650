"""Skinned meshes of glTF files are placed by their joints alone."""

import base64
import json

import numpy as np
import pytest

from dgl_assets.importing import UnreadableFileError
from dgl_assets.importing.read import read_mesh

POINTS = np.array([[0, 0, 0], [1.2, 0, 0], [1.2, 0, 0.25], [0, 0, 0.25]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
HALF = {"scale": [0.5, 0.5, 0.5]}


def write(path, nodes, *, roots, skin=None, inverse=None, weights=((1, 0, 0, 0),) * 4):
    """Write a scarf as text glTF; of the nodes the one with a mesh shows it."""
    parts = {
        "POSITION": (POINTS.astype("<f4"), 5126, "VEC3"),
        "indices": (FACES.astype("<u2").ravel(), 5123, "SCALAR"),
        "JOINTS_0": (np.tile(np.uint8([0, 1, 0, 0]), (4, 1)), 5121, "VEC4"),
        "WEIGHTS_0": (np.array(weights, "<f4"), 5126, "VEC4"),
    }
    tree = {"asset": {"version": "2.0"}, "scenes": [{"nodes": roots}], "nodes": nodes}
    if inverse is not None:
        columns = np.array([np.transpose(matrix) for matrix in inverse])
        parts["inverse"] = (columns.astype("<f4").reshape(-1, 16), 5126, "MAT4")
        skin = {**skin, "inverseBindMatrices": 4}
    body = b"".join(array.tobytes() for array, *_ in parts.values())
    starts = np.cumsum([0, *(array.nbytes for array, *_ in parts.values())]).tolist()
    tree["buffers"] = [
        {"byteLength": len(body), "uri": "data:a;base64," + base64.b64encode(body).decode()}
    ]
    tree["bufferViews"] = [
        {"buffer": 0, "byteOffset": start, "byteLength": array.nbytes}
        for start, (array, *_) in zip(starts, parts.values(), strict=False)
    ]
    tree["accessors"] = [
        {"bufferView": k, "componentType": kind, "count": len(array), "type": shape}
        for k, (array, kind, shape) in enumerate(parts.values())
    ]
    attributes = {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}
    tree["meshes"] = [{"primitives": [{"attributes": attributes, "indices": 1}]}]
    if skin is not None:
        tree["skins"] = [skin]
    path.write_text(json.dumps(tree))
    return path


def extent(path):
    return np.ptp(read_mesh(path).vertices, axis=0)


def test_transforms_above_a_skinned_mesh_do_not_act(tmp_path):
    nodes = [
        {"children": [1], **HALF},
        {"mesh": 0, "skin": 0, "translation": [0, 9, 0]},
        {"name": "Hips"},
        {"name": "Spine"},
    ]
    path = write(tmp_path / "a.gltf", nodes, roots=[0, 2, 3], skin={"joints": [2, 3]})
    assert read_mesh(path).vertices == pytest.approx(POINTS)
    del nodes[1]["skin"]  # without a skin they do
    path = write(tmp_path / "b.gltf", nodes, roots=[0, 2, 3])
    assert extent(path) == pytest.approx([0.6, 0, 0.125])


def test_joints_and_their_inverse_bind_matrices_place_a_skinned_mesh(tmp_path):
    nodes = [
        {"children": [1, 2], "scale": [0.01, 0.01, 0.01]},
        {"mesh": 0, "skin": 0},
        {"children": [3], "translation": [0, 50, 0]},
        {"translation": [10, 0, 0]},
    ]
    bind = np.diag([100.0, 100, 100, 1])
    skin = {"joints": [2, 3]}
    path = write(tmp_path / "a.gltf", nodes, roots=[0], skin=skin, inverse=[bind, bind])
    assert read_mesh(path).vertices == pytest.approx(POINTS + np.array([0, 0.5, 0]))
    weights = [(0.5, 0.5, 0, 0)] * 4  # between both joints
    path = write(
        tmp_path / "b.gltf", nodes, roots=[0], skin=skin, inverse=[bind, bind], weights=weights
    )
    assert read_mesh(path).vertices == pytest.approx(POINTS + np.array([0.05, 0.5, 0]))


def test_a_skin_without_weights_is_refused(tmp_path):
    nodes = [{"mesh": 0, "skin": 0}, {}, {}]
    path = write(
        tmp_path / "a.gltf",
        nodes,
        roots=[0, 1],
        skin={"joints": [1, 2]},
        weights=[(0, 0, 0, 0)] * 4,
    )
    with pytest.raises(UnreadableFileError, match="have no weights"):
        read_mesh(path)
