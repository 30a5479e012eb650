import imageio.v3 as iio
import numpy as np
import pytest

from dgl_collect import VideoWriter, save_png


def frame(value, shape=(48, 64, 3)):
    return np.full(shape, value, np.uint8)


def test_one_video_frame_per_frame_at_twelve_hertz(tmp_path):
    with VideoWriter(tmp_path / "a.mp4") as video:
        for value in (0, 80, 160, 240):
            video.add(frame(value))
    film = iio.imread(video.path, plugin="pyav")
    assert film.shape == (4, 48, 64, 3)
    assert np.abs(film.mean(axis=(1, 2, 3)) - [0, 80, 160, 240]).max() < 6
    with iio.imopen(video.path, "r", plugin="pyav") as file:
        metadata = file.metadata()
    assert metadata["codec"] == "h264"
    assert metadata["video_format"] == "yuv420p"
    assert metadata["fps"] == 12


def test_an_aborted_film_leaves_nothing(tmp_path):
    video = VideoWriter(tmp_path / "a.mp4")

    def film():
        with video:
            video.add(frame(1))
            raise RuntimeError("exploded")

    with pytest.raises(RuntimeError, match="exploded"):
        film()
    assert list(tmp_path.iterdir()) == []


def test_a_film_without_frames_is_refused_and_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="at least one frame"), VideoWriter(tmp_path / "a.mp4"):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (frame(0, (48, 64)), "got .48, 64. uint8"),
        (frame(0).astype(float), "float64"),
        (frame(0, (47, 64, 3)), "even"),
        (frame(0, (64, 64, 3)), "must have shape .48, 64, 3."),
    ],
)
def test_wrong_frames_are_refused(tmp_path, image, message):
    with VideoWriter(tmp_path / "a.mp4") as video:
        video.add(frame(0))
        with pytest.raises(ValueError, match=message):
            video.add(image)


def test_a_closed_film_takes_no_frames(tmp_path):
    with pytest.raises(RuntimeError, match="not open"):
        VideoWriter(tmp_path / "a.mp4").add(frame(0))


def test_a_film_is_an_mp4(tmp_path):
    with pytest.raises(ValueError, match=r"end in \.mp4"):
        VideoWriter(tmp_path / "a.avi")


def test_a_picture_keeps_its_pixels(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (6, 4, 3), np.uint8)
    np.testing.assert_array_equal(iio.imread(save_png(tmp_path / "x" / "a.png", image)), image)
    assert [path.name for path in (tmp_path / "x").iterdir()] == ["a.png"]
