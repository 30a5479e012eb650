"""The rule of gloves on a glove as it lies, and hands put into it."""

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_tasks.enclosing import BASES, EnclosesHand, is_enclosed
from dgl_tasks.views import TrueView

RULE = EnclosesHand(frame="person.right_hand", hand="person.right")


@pytest.fixture(scope="module")
def glove():
    return load_garment("Glove/000013")


@pytest.fixture
def put_on(glove):
    """View of a hand in the glove, by its fingertips: each at a depth in the tube of a digit."""

    def place(depth=0.2, shift=(0.0, 0.0, 0.0), **tubes):
        place_of = {name: glove.vertices[k].astype(float) for name, k in glove.landmarks.items()}
        hand = {"right_wrist": (place_of["wrist_palm"] + place_of["wrist_back"]) / 2 + shift}
        for digit in BASES:
            tube = tubes.get(digit, digit)
            base = np.mean([place_of[name] for name in BASES[tube]], axis=0)
            tip = place_of[f"{tube}_tip"]
            hand[f"right_{digit}_tip"] = tip + depth * (base - tip) + shift
        return TrueView(
            particles=glove.vertices,
            faces=glove.faces,
            upright=glove.vertices,
            landmarks={},
            marks={name: glove.landmarks[name] for name in RULE.marks},
            flat_area=1.0,
            frames={"person": hand},
        )

    return place


@pytest.mark.parametrize("depth", [0.1, 0.5, 0.9])
def test_a_hand_whose_fingers_are_in_their_tubes_wears_the_glove(put_on, depth):
    verdict = RULE(put_on(depth=depth))
    share, fingers, thumb = verdict.criteria
    assert verdict.success
    assert share.value > 0.95
    assert (fingers.value, thumb.value) == (4, 1)


def test_fingertips_in_the_palm_are_in_no_tube(put_on):
    _, fingers, thumb = RULE(put_on(depth=1.3)).criteria
    assert (fingers.value, thumb.value) == (0, 0)


@pytest.mark.parametrize(
    ("tubes", "own", "reason"),
    [
        ({"index": "middle"}, 3, None),
        ({"index": "middle", "middle": "index"}, 2, "fingers in wrong tubes"),
        ({"ring": "little", "little": "ring"}, 2, "fingers in wrong tubes"),
    ],
)
def test_three_fingers_must_be_in_their_own_tubes(put_on, tubes, own, reason):
    verdict = RULE(put_on(**tubes))
    assert verdict.criteria[1].value == own
    assert verdict.reason == reason


def test_most_of_the_hand_must_be_inside(put_on):
    out = [RULE(put_on(shift=(0.0, 0.01 * k, 0.0))) for k in range(25)]
    shares = np.array([verdict.value for verdict in out])
    assert shares[0] > 0.95
    assert shares[-1] < 0.2
    assert (np.diff(shares) <= 0.02).all()
    assert all((v.reason == "not put on") == (v.value < 0.8) for v in out)
    beside = RULE(put_on(shift=(0.0, 0.0, 0.3)))
    assert (beside.value, beside.criteria[1].value) == (0, 0)


def test_a_lid_closes_an_open_box():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]  # no lid
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    points = np.array([[0.5, 0.5, 0.01], [0.5, 0.5, 0.99], [0.5, 0.5, 1.01], [-0.01, 0.5, 0.5]])
    assert is_enclosed(points, corners, faces).tolist() == [True, True, False, False]
