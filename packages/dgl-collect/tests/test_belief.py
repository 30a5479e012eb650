"""The belief follows from cameras and matched points alone."""

import numpy as np
import pytest

from dgl_collect.belief import BelievedView
from dgl_tasks.errors import PerceptionError
from dgl_tasks.success import CoversFlatArea, ShareInBox

POINTS = {"left_hem": np.array([-0.2, 0.6, 0.0]), "right_hem": np.array([0.2, 0.6, 0.0])}
FLAT, FOLDED = 0.0148, 0.04
"""Height of what lies flat, and of folds as a fling leaves them, with air between their layers
[m]."""


class Cameras:
    """Two cameras and nothing else: whoever asks for the truth finds that there is none."""

    def __init__(self, **points):
        self.points = points
        self.frames = {"hanger": {"target": np.array([0.0, 0.8, 1.5])}}

    def see_points(self, camera):
        if self.points.get(camera) is None:
            raise PerceptionError("the camera sees nothing of the garment")
        return self.points[camera]


def make_view(**points):
    return BelievedView(Cameras(**points), landmarks=POINTS)


def make_sheet(width, length, height=FLAT):
    """Points all over a rectangle in front of the robots [m]."""
    x, y = np.meshgrid(np.arange(0.0025, width, 0.005), np.arange(0.0025, length, 0.005))
    return np.column_stack([x.ravel() - width / 2, y.ravel() + 0.5, np.full(x.size, height)])


def test_the_top_is_what_the_upper_camera_sees_and_the_surface_what_both_see():
    above, ahead = np.zeros((4, 3)), np.ones((3, 3))
    view = make_view(garment_camera=above, environment_camera=ahead)
    np.testing.assert_array_equal(view.top, above)
    np.testing.assert_array_equal(view.surface, [*above, *ahead])
    assert view.landmarks is POINTS
    np.testing.assert_array_equal(view.frames["hanger"]["target"], (0.0, 0.8, 1.5))


def test_what_is_out_of_sight_is_nowhere():
    view = make_view(environment_camera=np.ones((3, 3)))
    assert view.top.shape == (0, 3)
    assert view.surface.shape == (3, 3)
    rule = ShareInBox(
        left=("left_hem",), right=("right_hem",), near="left_hem", far="left_hem",
        margins=(0.1,) * 4, threshold=0.8,
    )  # fmt: skip
    assert rule(view).value == 0.0


def test_the_rule_is_applied_to_where_the_points_were_found():
    """Even if the points were found in the wrong place."""
    rule = ShareInBox(
        left=("left_hem",), right=("right_hem",), near="left_hem", far="left_hem",
        margins=(0.01,) * 4, threshold=0.8,
    )  # fmt: skip
    view = make_view(garment_camera=np.array([[0.0, 0.6, 0.0], [0.0, 0.9, 0.0]]))
    assert rule(view).value == 0.5
    assert rule(view).box == pytest.approx((-0.21, 0.59, 0.21, 0.61))


def test_what_is_out_of_sight_covers_nothing():
    verdict = CoversFlatArea()(make_view(environment_camera=np.ones((3, 3))))
    assert not verdict.success
    assert verdict.value == 0.0


@pytest.mark.parametrize(("width", "length"), [(0.5, 0.6), (0.8, 1.0)])
def test_a_garment_of_two_layers_lies_flat(width, length):
    view = make_view(garment_camera=make_sheet(width, length))
    assert view.flat_area == pytest.approx(width * length, rel=0.01)
    assert CoversFlatArea()(view).success


@pytest.mark.parametrize(
    ("folded", "success"), [(0.05, True), (0.1, True), (0.25, False), (0.4, False)]
)
def test_where_it_is_folded_more_layers_lie_on_each_other(folded, success):
    """A strip of 1 m, of which a part lies over the rest."""
    over = make_sheet(0.5, folded, height=FOLDED)
    rest = np.add(make_sheet(0.5, 1.0 - 2 * folded), (0.0, folded, 0.0))
    view = make_view(garment_camera=np.concatenate([over, rest]))
    assert 1.0 - folded < view.flat_area / 0.5 < 1.0 + 1e-3
    assert CoversFlatArea()(view).success is success


def test_each_camera_looks_once():
    class Counting(Cameras):
        looks = 0

        def see_points(self, camera):
            self.looks += 1
            return super().see_points(camera)

    cameras = Counting(garment_camera=np.zeros((4, 3)), environment_camera=np.ones((3, 3)))
    view = BelievedView(cameras, landmarks={})
    assert (len(view.top), len(view.surface), len(view.top)) == (4, 7, 4)
    assert cameras.looks == 2
