"""Declarations: fields of another type or out of range are refused in one line."""

import dataclasses

import numpy as np

import dgl_tasks
from dgl_tasks.cameras import CameraPlacement, Workspace
from dgl_tasks.declaration import HandFriction, SceneObject, Start
from dgl_tasks.success import HangsOver, RestsOn, ShareInBox, SitsOn

TASK = dgl_tasks.get_task("FoldTops-v1")
OBJECT = SceneObject(name="bar", prop="hanger", position=(0, 0.85, 0))
UNITY = r"(greater|less) than or equal to"


def test_a_wrong_field_is_named_with_its_type_and_value(refuse):
    table = [
        (
            SceneObject,
            OBJECT,
            {"x_range": 0.2},
            "SceneObject: x_range should be a valid tuple; got",
        ),
        (SceneObject, OBJECT, {"y_range": (0, 0, 0)}, r"y_range: .*at most 2 .*; got \(0, 0, 0\)"),
        (SceneObject, OBJECT, {"y_range": (np.nan, 0)}, r"y_range\[0\] .*finite number; got nan"),
        (SceneObject, OBJECT, {"x_range": (0.1, -0.1)}, r"x_range must be \(low, high\)"),
        (SceneObject, OBJECT, {"position": "abc"}, "position should be a valid tuple; got 'abc'"),
        (SceneObject, OBJECT, {"position": (0, 0, True)}, r"position\[2\] .*number; got True"),
        (SceneObject, OBJECT, {"position": (0, 0)}, r"position\[2\]: field required"),
        (SceneObject, OBJECT, {"yaw": np.inf}, "yaw should be a finite number; got inf"),
        (
            SceneObject,
            OBJECT,
            {"friction": "high"},
            "friction should be a valid number; got 'high'",
        ),
        (SceneObject, OBJECT, {"friction": -1}, f"friction should be {UNITY} 0; got -1"),
        (SceneObject, OBJECT, {"name": 3}, "name should be a valid string; got 3"),
        (SceneObject, OBJECT, {"name": "clothes rack"}, "an identifier .*; got 'clothes rack'"),
        (SceneObject, OBJECT, {"name": "rack.left"}, "an identifier .*; got 'rack.left'"),
        (SceneObject, OBJECT, {"name": ""}, "an identifier .*; got ''"),
        (SceneObject, OBJECT, {"name": "now"}, "other than garment, now, ground; got 'now'"),
        (
            SceneObject,
            OBJECT,
            {"prop": 3},
            "prop should be a valid string or an instance of Hanger",
        ),
        (SceneObject, OBJECT, {"solid_to": "arms"}, "'robot', 'hands' or 'garment'; got 'arms'"),
        (None, TASK, {"left_base": (0, 0, 0)}, r"Task: left_base\[3\]: field required"),
        (None, TASK, {"objects": OBJECT}, "objects should be a valid tuple; got SceneObject"),
        (None, TASK, {"objects": ("bar",)}, r"objects\[0\] .*instance of SceneObject; got 'bar'"),
        (None, TASK, {"start": "floor"}, "start should be an instance of Start; got 'floor'"),
        (None, TASK, {"success": 0.8}, "success should be an instance of SuccessRule; got 0.8"),
        (None, TASK, {"success": ShareInBox}, r"such as ShareInBox\(...\); got the class"),
        (None, TASK, {"category": "Tops_LongSleve"}, r"did you mean Tops_LongSleeve\?"),
        (None, TASK, {"cameras": []}, "cameras should be a valid dictionary; got"),
        (None, TASK, {"cameras": {}}, "cameras must be garment_camera, .*; got"),
        (None, TASK, {"picture_camera": "phone"}, "cameras must be .*; got .*'phone'"),
        (None, TASK, {"stiffness": {"brim": "stiff"}}, "stiffness.brim should be a valid number"),
        (None, TASK, {"material": 3}, "instance of ClothMaterial or an instance of SolidMaterial"),
        (None, TASK, {"id": 5}, "Task: id should be a valid string; got 5"),
        (None, TASK.success, {"left": "collar"}, "ShareInBox: left should be a valid tuple"),
        (Start, None, {"settle_frames": 1.5}, "settle_frames should be a valid integer; got 1.5"),
        (Start, None, {"settle_frames": -1}, f"settle_frames should be {UNITY} 0; got -1"),
        (Start, None, {"height": "0.2"}, "height should be a valid number; got '0.2'"),
        (Start, None, {"height": -0.1}, f"height should be {UNITY} 0; got -0.1"),
        (Start, None, {"roll_range": (1.0, 0.5)}, r"roll_range must be \(low, high\)"),
        (HandFriction, None, {"fingers": True}, "fingers should be a valid number; got True"),
        (HandFriction, None, {"fingers": -1.0}, f"fingers should be {UNITY} 0; got -1.0"),
        (HandFriction, None, {"thumb": np.nan}, "thumb should be a finite number; got nan"),
        (Workspace, None, {"low": 0}, "Workspace: low should be a valid tuple; got 0"),
        (Workspace, None, {"high": (1, 1, np.nan)}, "low must be below high on every axis"),
        (HangsOver, None, {"frame": 3, "sideways": 0.1}, "HangsOver: frame .*string; got 3"),
        (HangsOver, None, {"frame": "a.b", "sideways": -0.05}, f"sideways should be {UNITY} 0"),
        (
            HangsOver,
            None,
            {"frame": "a.b", "sideways": 1, "on_ground": 2},
            f"on_ground .*{UNITY} 1",
        ),
        (HangsOver, None, {"frame": "a.b", "sideways": 1, "below": -1}, f"below .*{UNITY} 0"),
        (RestsOn, None, {"frame": "a.b", "within": 0.1, "lower": 3}, f"lower .*{UNITY} 1; got 3"),
        (SitsOn, None, {"frame": "a.b", "within": np.inf, "leaning": 1}, "within .*; got inf"),
        (
            CameraPlacement,
            None,
            {"name": "c", "position": (0, 0, 1), "euler_deg": "down"},
            "CameraPlacement: euler_deg should be a valid tuple; got 'down'",
        ),
    ]
    assert not refuse(
        (
            (lambda b=base, c=change: dataclasses.replace(b, **c))
            if base is not None
            else (lambda k=kind, c=change: k(**c)),
            message,
        )
        for kind, base, change, message in table
    )


def test_lists_and_arrays_become_tuples_so_that_declarations_can_be_hashed():
    listed = dataclasses.replace(
        OBJECT, position=[0, 0.85, 0], x_range=np.array([-0.1, 0.1]), yaw=np.float32(0.5)
    )
    assert (listed.position, listed.x_range, listed.yaw) == ((0, 0.85, 0), (-0.1, 0.1), 0.5)
    assert hash(listed) == hash(dataclasses.replace(OBJECT, x_range=(-0.1, 0.1), yaw=0.5))
    assert dataclasses.replace(TASK, objects=[OBJECT]).objects == (OBJECT,)
    assert Workspace(low=(-1, -1, -np.inf)).low[2] == -np.inf
