"""Probes of `dgl doctor`, each run in its own process, which a broken driver may end.

A probe does the real thing in small, returns facts about it, and raises when it does not work.
"""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

__all__ = ["PROBES", "assert_shows_box", "main"]


_PACKAGES = ("dexgarmentlab", "dgl-physics", "dgl-assets", "dgl-gam", "dgl-sadp", "dgl-tasks")
_PACKAGES += ("dgl-collect", "dgl-files")


def probe_packages() -> dict[str, object]:
    """Import what the tasks are built on; a missing package or system library shows here."""
    import warnings
    from importlib import metadata

    missing = [
        name
        for package in _PACKAGES
        for name in _list_required(package)
        if not any(metadata.distributions(name=name))
    ]
    if missing:
        raise RuntimeError(f"not installed: {', '.join(sorted(set(missing)))}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Deprecations inside of other libraries.
        import gymnasium
        import h5py
        import mani_skill.envs
        import placo
        import torch

    assert placo is not None
    assert mani_skill.envs is not None
    return {
        "gymnasium": gymnasium.__version__,
        "torch": torch.__version__,
        "h5py": h5py.__version__,
        "mani_skill": mani_skill.__version__,
    }


def _list_required(package: str) -> list[str]:
    """List the distributions that a package needs, without its extras."""
    from importlib import metadata

    needed = [r for r in metadata.requires(package) or () if "extra ==" not in r]
    return [re.split(r"[^A-Za-z0-9._-]", r, maxsplit=1)[0] for r in needed if ";" not in r]


def probe_rendering() -> dict[str, object]:
    """Draw an orange box in front of nothing with SAPIEN, which needs a usable Vulkan device."""
    import sapien

    # Without light: for lit pictures SAPIEN first fills a table, which takes a processor 6 s.
    sapien.render.set_camera_shader_dir("trivial")
    scene = sapien.Scene()
    builder = scene.create_actor_builder()
    builder.add_box_visual(
        half_size=(0.2, 0.2, 0.2),
        material=sapien.render.RenderMaterial(base_color=[0.9, 0.4, 0.1, 1.0]),
    )
    builder.build_static(name="box")
    camera = scene.add_camera("camera", 64, 48, 1.0, 0.01, 10.0)
    camera.entity.set_pose(sapien.Pose([-1.0, 0.0, 0.0]))
    scene.update_render()
    camera.take_picture()
    picture = np.asarray(camera.get_picture("Color"))[..., :3]  # (H, W, 3) in [0, 1]
    assert_shows_box(picture)
    return {"device": scene.render_system.device.name, "brightness": float(picture.max())}


def assert_shows_box(picture: np.ndarray) -> None:
    """Check that a picture shows the orange box and its surroundings, and is not of one colour.

    Args:
        picture: Colours in [0, 1], shape (H, W, 3).

    Raises:
        RuntimeError: If the picture is black or of one colour, or its middle is not orange.
    """
    if not np.isfinite(picture).all():
        raise RuntimeError("the picture holds colours that are not numbers")
    if picture.max() < 0.02:
        raise RuntimeError("the picture is uniformly black")
    if np.ptp(picture, axis=(0, 1)).max() < 0.02:
        raise RuntimeError("the picture is of one colour")
    red, _, blue = picture[picture.shape[0] // 2, picture.shape[1] // 2]
    if red <= blue:
        raise RuntimeError(
            f"the box should be orange; its red is {red:.2f} and its blue {blue:.2f}"
        )


def probe_physics() -> dict[str, object]:
    """Let a ball fall freely in SAPIEN for half a second and compare with g t² / 2."""
    import sapien

    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])  # No renderer: physics alone is asked.
    scene.set_timestep(1 / 240)
    builder = scene.create_actor_builder()
    builder.add_sphere_collision(radius=0.1)
    ball = builder.build(name="ball")
    ball.set_pose(sapien.Pose([0.0, 0.0, 10.0]))
    for _ in range(120):
        scene.step()
    fallen = 10.0 - float(ball.pose.p[2])
    expected = 0.5 * 9.81 * 0.5**2
    if abs(fallen - expected) > 0.05:
        raise RuntimeError(f"a ball fell {fallen:.3f} m in 0.5 s; expected {expected:.3f} m")
    return {"version": sapien.__version__}


def probe_warp() -> dict[str, object]:
    """Compile and run a kernel with Warp on the CPU."""
    import warp as wp

    from dexgarmentlab._probe_kernel import double
    from dgl_physics.launcher import find_vector_obstacle

    values = wp.array(np.arange(8, dtype=np.float32), device="cpu")
    wp.launch(double, dim=8, inputs=[values], device="cpu")
    if not np.array_equal(values.numpy(), 2 * np.arange(8, dtype=np.float32)):
        raise RuntimeError(f"a kernel that doubles 0 ... 7 gave {values.numpy().tolist()}")
    return {"version": wp.config.version, "slow_because": find_vector_obstacle()}


def probe_cuda() -> dict[str, object]:
    """Name the CUDA devices that Warp and PyTorch can use, having computed something on each."""
    import torch
    import warp as wp

    from dexgarmentlab._probe_kernel import double

    devices = []
    for device in wp.get_cuda_devices():
        values = wp.array(np.ones(8, dtype=np.float32), device=device)
        wp.launch(double, dim=8, inputs=[values], device=device)
        if not np.array_equal(values.numpy(), np.full(8, 2.0, dtype=np.float32)):
            raise RuntimeError(f"Warp computed wrongly on {device.name}")
        devices.append(device.name)
    if not devices:
        raise RuntimeError("Warp finds no CUDA device")
    if not torch.cuda.is_available():
        raise RuntimeError(
            f"PyTorch {torch.__version__} cannot use CUDA (it was built for {torch.version.cuda})"
        )
    if float(torch.ones(8, device="cuda").sum()) != 8.0:
        raise RuntimeError("PyTorch computed wrongly")
    return {"devices": devices}


def probe_video() -> dict[str, object]:
    """Write a short H.264 video into memory, read it back, and compare."""
    import io

    import imageio.v3 as iio

    ramp = np.linspace(0, 255, 64, dtype=np.uint8)
    frames = np.stack([np.broadcast_to(ramp[:, None, None], (64, 64, 3))] * 6)  # (T, H, W, 3)
    file = io.BytesIO()
    iio.imwrite(file, frames, plugin="pyav", extension=".mp4", codec="libx264", fps=12)
    read = iio.imread(file.getvalue(), plugin="pyav", extension=".mp4")
    if read.shape != frames.shape:
        raise RuntimeError(f"wrote frames of shape {frames.shape}; read {read.shape}")
    error = float(np.abs(read.astype(float) - frames).mean())
    if error > 8.0:
        raise RuntimeError(f"the frames read differ from those written by {error:.1f} of 255")
    return {"bytes": len(file.getvalue())}


PROBES: dict[str, Callable[[], dict[str, object]]] = {
    "packages": probe_packages,
    "rendering": probe_rendering,
    "physics": probe_physics,
    "warp": probe_warp,
    "cuda": probe_cuda,
    "video": probe_video,
}


def main(argv: list[str]) -> int:
    """Run one probe and store its facts, or its error, as JSON in a file.

    Args:
        argv: Name of the probe and path of the file. A file, because libraries write to the
            standard output.

    Returns:
        The exit status.
    """
    name, path = argv
    try:
        result: dict[str, object] = {"facts": PROBES[name]()}
    except Exception as error:
        result = {"error": f"{type(error).__name__}: {error}"}
    Path(path).write_text(json.dumps(result), encoding="utf-8")
    return 1 if "error" in result else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
