"""Configuration of a policy: frozen, checked, stored as JSON with each checkpoint."""

import dataclasses
import difflib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from annotated_types import Interval, Len

from dgl_files.fields import STRICT, check_fields, decode_json, from_plain

__all__ = [
    "DiffusionConfig",
    "EncoderLevelConfig",
    "GarmentConfig",
    "ImageConfig",
    "Method",
    "PointsConfig",
    "PolicyConfig",
    "PolicySize",
    "UNetConfig",
    "get_policy_config",
]

Method = Literal["sadp", "sadp-g", "dp3", "dp"]
"""The policies: they differ only by what they observe and by the table's sizes."""
PolicySize = Literal["small", "paper"]
"""The presets of each: "small" trains on a CPU, "paper" has the published sizes."""

Width = Annotated[int, Interval(ge=1, le=8192)]
Widths = Annotated[tuple[Width, ...], Len(1, 16)]
Points = Annotated[int, Interval(ge=1, le=2**16)]
MAX_ACTIVATIONS = 2**26
"""Most values [float32] of one layer's output for one observation: 256 MiB."""


@dataclass(frozen=True, kw_only=True)
class UNetConfig:
    """Sizes of the one-dimensional U-Net that denoises action chunks."""

    __pydantic_config__ = STRICT

    widths: Annotated[tuple[Width, ...], Len(1, 8)]
    """Channels of each level, each a multiple of `groups`."""
    step_embedding: Annotated[int, Interval(ge=4, le=8192)]
    """Length of the embedding of the denoising step, even."""
    kernel: Annotated[int, Interval(ge=1, le=63)] = 5
    """Length of the convolutions [frames], odd."""
    groups: Annotated[int, Interval(ge=1, le=1024)] = 8
    """Groups of the group norms."""
    film: Width | None = None
    """Width of a layer between the condition and the scales and biases of all blocks; None for
    none, as published. They are half of all weights without it."""

    def __post_init__(self) -> None:
        check_fields(self)
        if any(width % self.groups for width in self.widths):
            raise ValueError(
                f"widths must be multiples of groups = {self.groups}; got {self.widths}"
            )
        if self.kernel % 2 == 0:
            raise ValueError(f"kernel must be odd; got {self.kernel}")
        if self.step_embedding % 2:
            raise ValueError(f"step_embedding must be even; got {self.step_embedding}")


@dataclass(frozen=True, kw_only=True)
class DiffusionConfig:
    """Diffusion settings. Source: DexGarmentLab's code; 10 denoising steps: paper."""

    __pydantic_config__ = STRICT

    scheduler: Literal["ddim", "ddpm"] = "ddim"
    """Scheduler of the denoising."""
    prediction: Literal["sample", "epsilon"] = "sample"
    """Prediction of the network: the clean actions or the noise."""
    training_steps: Annotated[int, Interval(ge=1, le=10_000)] = 100
    """Levels of noise."""
    inference_steps: Annotated[int, Interval(ge=1, le=10_000)] = 10
    """Denoising steps of an inference, at most `training_steps`."""
    beta_start: Annotated[float, Interval(ge=0.0, le=0.999)] = 1e-4
    """First variance of the schedule."""
    beta_end: Annotated[float, Interval(ge=0.0, le=0.999)] = 0.02
    """Last variance of the schedule; the squared cosine schedule does not use it, others would."""
    beta_schedule: Literal["squaredcos_cap_v2", "linear"] = "squaredcos_cap_v2"
    """Schedule of the variance."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.inference_steps > self.training_steps:
            raise ValueError(
                f"inference_steps must lie in 1 ... {self.training_steps}; got "
                f"{self.inference_steps}"
            )
        if not 0.0 < self.beta_start <= self.beta_end:
            raise ValueError(
                "beta_start must be positive and at most beta_end; "
                f"got {self.beta_start} and {self.beta_end}"
            )


@dataclass(frozen=True, kw_only=True)
class PointsConfig:
    """A cloud seen point by point: layers of each point, the maximum over them, one layer."""

    __pydantic_config__ = STRICT

    points: Points
    """Points taken from the cloud."""
    widths: Widths
    """Channels of the layers of a point."""
    features: Width
    """Length of the cloud's feature."""
    use_color: bool = False
    """Observe colour beside position; the cloud must have it."""

    def __post_init__(self) -> None:
        check_fields(self)
        _check_activations("points x the widest layer", self.points * max(self.widths))


@dataclass(frozen=True, kw_only=True)
class EncoderLevelConfig:
    """One level of PointNet++: centres, and a network over the neighbours of each."""

    __pydantic_config__ = STRICT

    centres: Annotated[int, Interval(ge=0, le=2**16)]
    """Centres; 0 gathers all points into one group."""
    radius: Annotated[float, Interval(ge=0.0, le=1000.0)]
    """Largest distance of a neighbour, in the normalised frame (garments lie within [-1, 1])."""
    neighbours: Annotated[int, Interval(ge=0, le=4096)]
    """Neighbours of a centre."""
    widths: Widths
    """Channels of the layers."""

    def __post_init__(self) -> None:
        check_fields(self)
        _check_activations(
            "centres x neighbours x the widest layer",
            self.centres * self.neighbours * max(self.widths),
        )
        if self.centres and not (self.radius > 0 and self.neighbours > 0):
            raise ValueError(
                "a level with centres needs a radius and neighbours > 0; "
                f"got centres {self.centres}, radius {self.radius}, neighbours {self.neighbours}"
            )


@dataclass(frozen=True, kw_only=True)
class GarmentConfig:
    """The garment with its affordance, seen by a PointNet++ that ends in one feature."""

    __pydantic_config__ = STRICT

    points: Points
    """Points taken from the cloud."""
    levels: Annotated[tuple[EncoderLevelConfig, ...], Len(1, 8)]
    """Levels, fine to coarse; the last one, and it alone, has no centres."""
    features: Width
    """Length of the garment's feature."""
    use_affordance: bool = True
    """Observe the affordance channels; without them the matcher has no effect."""

    def __post_init__(self) -> None:
        check_fields(self)
        centres = [level.centres for level in self.levels]
        if centres[-1] != 0 or 0 in centres[:-1]:
            raise ValueError(f"of the levels only the last has no centres; got {centres}")
        if any(a <= b for a, b in zip([self.points, *centres], centres, strict=False)):
            raise ValueError(f"levels must have fewer and fewer of {self.points}; got {centres}")
        last = centres[-2] if len(centres) > 1 else self.points
        _check_activations(
            "the points of the last level x its widest layer", last * max(self.levels[-1].widths)
        )


@dataclass(frozen=True, kw_only=True)
class ImageConfig:
    """The environment camera's picture, seen by a residual network of 18 layers."""

    __pydantic_config__ = STRICT

    height: Annotated[int, Interval(ge=32, le=4096)]
    """Rows that pictures are scaled to [pixel]."""
    width: Annotated[int, Interval(ge=32, le=4096)]
    """Columns that pictures are scaled to [pixel]."""
    widths: tuple[Width, Width, Width, Width]
    """Channels of the four residual stages, multiples of 16; the last is the feature's length."""

    def __post_init__(self) -> None:
        check_fields(self)
        if any(width % 16 for width in self.widths):
            raise ValueError(f"widths must be four multiples of 16; got {self.widths}")
        _check_activations(
            "a quarter of height x width x the widest layer",
            self.height * self.width * max(self.widths) // 4,
        )


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """One diffusion policy: horizons, sizes, and an encoder for each thing that it observes."""

    __pydantic_config__ = STRICT

    method: Method
    """Name of the policy; determines the encoders."""
    unet: UNetConfig
    """The denoising network."""
    diffusion: DiffusionConfig
    """The noise."""
    state: Annotated[tuple[Width, ...], Len(0, 16)]
    """Widths of the joint state's layers with ReLU between them; () passes the normalised state
    on."""
    relative_joints: Annotated[tuple[int, ...], Len(0, 1024)]
    """Joints, ascending, whose targets are learned relative to the start of the stage. Their motion
    since then is observed beside the joint state."""
    environment: PointsConfig | None = None
    """Environment cloud, in every observation."""
    garment: GarmentConfig | None = None
    """Garment cloud and affordance, once a stage."""
    object: PointsConfig | None = None
    """Object cloud, once a stage."""
    image: ImageConfig | None = None
    """Picture, in every observation."""
    joints: Annotated[int, Interval(ge=1, le=1024)] = 60
    """Joints of the robot, and length of an action."""
    stages: Annotated[int, Interval(ge=1, le=1000)] = 1
    """Stages of the task that the policy acts in; if there are several, it is told which one."""
    horizon: Annotated[int, Interval(ge=1, le=1024)] = 8
    """Predicted actions. Source: paper."""
    observation_steps: Annotated[int, Interval(ge=1, le=64)] = 3
    """Observations that a prediction sees. Source: paper."""
    action_steps: Annotated[int, Interval(ge=1, le=1024)] = 4
    """Executed actions, from the last observation's on. Source: paper."""

    def __post_init__(self) -> None:
        check_fields(self)
        _check_activations(
            "horizon x kernel x the widest level",
            self.horizon * self.unet.kernel * max(*self.unet.widths, self.joints),
        )
        needed = self.observation_steps - 1 + self.action_steps
        if self.horizon < needed:
            raise ValueError(
                "horizon must be at least observation_steps - 1 + action_steps = "
                f"{needed}; got {self.horizon}"
            )
        factor = 2 ** (len(self.unet.widths) - 1)
        if self.horizon % factor:
            raise ValueError(
                f"horizon must be a multiple of {factor}, since the U-Net has "
                f"{len(self.unet.widths)} levels; got {self.horizon}"
            )
        chosen = set(self.relative_joints)
        if [*self.relative_joints] != [joint for joint in range(self.joints) if joint in chosen]:
            raise ValueError(
                f"relative_joints must ascend within 0 ... {self.joints - 1}; got "
                f"{self.relative_joints}"
            )
        if self.object is not None and self.object.use_color:
            raise ValueError("object must not use_color: its recorded cloud has none")
        there = {name for name in _ENCODERS if getattr(self, name) is not None}
        if there != _OBSERVED[self.method]:
            raise ValueError(
                f"{self.method} observes {sorted(_OBSERVED[self.method])}; got {sorted(there)}"
            )

    @property
    def executed(self) -> slice:
        """Indices of the executed actions: 2 ... 5 as published."""
        first = self.observation_steps - 1
        return slice(first, first + self.action_steps)

    @property
    def frame_keys(self) -> tuple[str, ...]:
        """Observations that are taken at every frame, named as in episode files."""
        names = {"environment": "env_point_cloud", "image": "image"}
        seen = [key for name, key in names.items() if getattr(self, name) is not None]
        return ("joint_state", *seen)

    @property
    def stage_keys(self) -> tuple[str, ...]:
        """Observations that are taken once a stage, named as in episode files."""
        keys: list[str] = []
        if self.garment is not None:
            keys.append("garment_point_cloud")
            if self.garment.use_affordance:
                keys.append("points_affordance_feature")
        if self.object is not None:
            keys.append("object_point_cloud")
        return tuple(keys)

    def to_json(self) -> str:
        """Write as JSON, as checkpoints store it."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "PolicyConfig":
        """Read what `to_json` wrote.

        Raises:
            ValueError: If it is no JSON object, or a field is missing, unknown or of a wrong type.
        """
        return from_plain(cls, decode_json(text))


ARM_JOINTS = (*range(6), *range(30, 36))
"""Joints of both arms, left and right, among the 60 of the robot."""
_ENCODERS = ("environment", "garment", "object", "image")
_OBSERVED: Mapping[str, set[str]] = {
    "sadp": {"environment", "garment", "object"},
    "sadp-g": {"environment", "garment"},
    "dp3": {"environment"},
    "dp": {"image"},
}


def get_policy_config(method: str, size: str = "small") -> PolicyConfig:
    """Return a preset of a policy.

    Args:
        method: "sadp", "sadp-g", "dp3" or "dp".
        size: "small", for a CPU, or "paper".

    Raises:
        ValueError: If there is no such policy or preset.
    """
    for name, value, allowed in (
        ("method", method, get_args(Method)),
        ("size", size, get_args(PolicySize)),
    ):
        if value not in allowed:
            near = difflib.get_close_matches(value, allowed, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{name} must be one of {list(allowed)}; got {value!r}{hint}")
    return _PRESETS[size][method]


def _paper_presets() -> Mapping[str, PolicyConfig]:
    """Sizes of DexGarmentLab's code (see docs); norms are layer norms where it has batch norms."""

    def points(features: int) -> PointsConfig:
        return PointsConfig(points=2048, widths=(64, 128, 256), features=features)

    def garment(features: int) -> GarmentConfig:
        return GarmentConfig(
            points=2048,
            levels=(
                EncoderLevelConfig(centres=512, radius=0.2, neighbours=32, widths=(64, 64, 128)),
                EncoderLevelConfig(centres=128, radius=0.4, neighbours=64, widths=(128, 128, 256)),
                EncoderLevelConfig(centres=0, radius=0.0, neighbours=0, widths=(256, 256, 512)),
            ),
            features=features,
        )

    unet = UNetConfig(widths=(512, 1024, 2048), step_embedding=64)
    return {
        "sadp": PolicyConfig(
            method="sadp",
            unet=unet,
            diffusion=DiffusionConfig(),
            state=(128, 64),
            relative_joints=ARM_JOINTS,
            environment=points(128),
            garment=garment(32),
            object=points(32),
        ),
        "sadp-g": PolicyConfig(
            method="sadp-g",
            unet=unet,
            diffusion=DiffusionConfig(),
            state=(128, 64),
            relative_joints=ARM_JOINTS,
            environment=points(128),
            garment=garment(64),
        ),
        "dp3": PolicyConfig(
            method="dp3",
            unet=unet,
            diffusion=DiffusionConfig(),
            state=(64, 64),
            relative_joints=ARM_JOINTS,
            environment=points(128),
        ),
        "dp": PolicyConfig(
            method="dp",
            unet=UNetConfig(widths=(256, 512, 1024), step_embedding=128),
            diffusion=DiffusionConfig(scheduler="ddpm", prediction="epsilon", inference_steps=100),
            state=(),
            relative_joints=ARM_JOINTS,
            image=ImageConfig(height=480, width=640, widths=(64, 128, 256, 512)),
        ),
    }


def _small_presets() -> Mapping[str, PolicyConfig]:
    """Make the small presets: fewer points, narrower layers, the same horizons."""

    def points(features: int) -> PointsConfig:
        return PointsConfig(points=256, widths=(32, 64, 128), features=features)

    def garment(features: int) -> GarmentConfig:
        return GarmentConfig(
            points=512,
            levels=(
                EncoderLevelConfig(centres=64, radius=0.2, neighbours=16, widths=(32, 64)),
                EncoderLevelConfig(centres=16, radius=0.5, neighbours=16, widths=(64, 128)),
                EncoderLevelConfig(centres=0, radius=0.0, neighbours=0, widths=(128, 256)),
            ),
            features=features,
        )

    # The deepest level has two frames: a longer kernel would see padding.
    unet = UNetConfig(widths=(64, 128, 192), step_embedding=64, kernel=3, film=96)
    paper = _paper_presets()
    return {
        "sadp": dataclasses.replace(
            paper["sadp"], unet=unet, environment=points(64), garment=garment(64), object=points(32)
        ),
        "sadp-g": dataclasses.replace(
            paper["sadp-g"], unet=unet, environment=points(64), garment=garment(64)
        ),
        "dp3": dataclasses.replace(paper["dp3"], unet=unet, environment=points(64)),
        "dp": dataclasses.replace(
            paper["dp"],
            unet=unet,
            image=ImageConfig(height=96, width=128, widths=(16, 32, 64, 128)),
        ),
    }


def _check_activations(name: str, count: int) -> None:
    if count > MAX_ACTIVATIONS:
        raise ValueError(f"{name} must be at most {MAX_ACTIVATIONS}; got {count}")


_PRESETS: Mapping[str, Mapping[str, PolicyConfig]] = {
    "paper": _paper_presets(),
    "small": _small_presets(),
}
