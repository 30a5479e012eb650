import numpy as np
import pytest

from dgl_tasks.hanging import measure_hanging

LEFT, RIGHT = np.array([-0.2, 0.4, 1.0]), np.array([0.2, 0.4, 1.0])


def make_sheet(sag, length=0.6, turn=0.0):
    """Points of a sheet whose upper edge is a parabola of this depth, held by hands 0.4 m apart."""
    x = np.linspace(-0.25, 0.25, 101)
    edge = 1.0 - sag * np.clip(1 - (x / 0.2) ** 2, 0, 1)
    rows = [
        np.stack([x, np.zeros_like(x), edge - s * (edge - 1.0 + length)], 1)
        for s in np.linspace(0, 1, 61)
    ]
    c, s = np.cos(turn), np.sin(turn)
    return np.concatenate(rows) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [0, 0.4, 0]


@pytest.mark.parametrize("sag", [0.0, 0.02, 0.1])
def test_sag_and_length_are_those_of_the_sheet(sag):
    seen = measure_hanging(make_sheet(sag), LEFT, RIGHT)
    # the edge is highest at the end of the part that is looked at
    assert seen.sag == pytest.approx(sag * (1 - 0.3**2), abs=0.004)
    assert seen.length == pytest.approx(0.6, abs=0.01)


def test_hands_may_be_at_any_place_and_height():
    turn, centre = 0.7, np.array([0.0, 0.4, 1.0])
    c, s = np.cos(turn), np.sin(turn)
    along = 0.2 * np.array([c, s, 0.0])
    seen = measure_hanging(make_sheet(0.05, turn=turn), centre - along, centre + along)
    assert seen.sag == pytest.approx(0.0455, abs=0.004)


def test_what_hangs_from_one_hand_has_no_edge_between_them():
    strip = make_sheet(0.0)
    seen = measure_hanging(strip[strip[:, 0] < -0.1], LEFT, RIGHT)
    assert seen.sag == np.inf
    assert seen.length == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize(
    ("points", "left", "message"),
    [
        (np.zeros((0, 3)), LEFT, "points must have shape"),
        (np.zeros((4, 2)), LEFT, "points must have shape"),
        (np.zeros((4, 3)), LEFT[:2], "hands must have shape"),
        (np.zeros((4, 3)), RIGHT, "hands must be apart"),
    ],
)
def test_wrong_input_is_refused(points, left, message):
    with pytest.raises(ValueError, match=message):
        measure_hanging(points, left, RIGHT)
