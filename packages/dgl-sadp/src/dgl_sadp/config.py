"""What a policy observes and how large it is: frozen, checked, stored as JSON with each checkpoint."""

import dataclasses
import difflib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

__all__ = [
    "DiffusionConfig",
    "GarmentConfig",
    "ImageConfig",
    "LevelConfig",
    "Method",
    "PointsConfig",
    "PolicyConfig",
    "PolicySize",
    "UNetConfig",
    "from_plain",
    "get_policy_config",
]

Method = Literal["sadp", "sadp-g", "dp3", "dp"]
"""The policies: they differ only by what they observe and by the table's sizes."""
PolicySize = Literal["small", "paper"]
"""The presets of each: "small" trains on a CPU, "paper" has the published sizes."""

C = TypeVar("C")


@dataclass(frozen=True, kw_only=True)
class UNetConfig:
    """Sizes of the one-dimensional U-Net that denoises action chunks."""

    widths: tuple[int, ...]
    """Channels of each level, each a multiple of `groups`."""
    step_embedding: int
    """Length of the embedding of the denoising step, even."""
    kernel: int = 5
    """Length of the convolutions [frames], odd."""
    groups: int = 8
    """Groups of the group norms."""

    def __post_init__(self) -> None:
        if not self.widths or any(width < 1 or width % self.groups for width in self.widths):
            raise ValueError(
                f"widths must be positive multiples of groups = {self.groups}; got {self.widths}"
            )
        if self.kernel < 1 or self.kernel % 2 == 0:
            raise ValueError(f"kernel must be odd; got {self.kernel}")
        if self.step_embedding < 4 or self.step_embedding % 2:
            raise ValueError(f"step_embedding must be even and >= 4; got {self.step_embedding}")


@dataclass(frozen=True, kw_only=True)
class DiffusionConfig:
    """The noise and its removal. Source of the numbers: DexGarmentLab's code; 10 denoising steps: paper."""

    scheduler: Literal["ddim", "ddpm"] = "ddim"
    """How noise is removed."""
    prediction: Literal["sample", "epsilon"] = "sample"
    """What the network predicts: the clean actions or the noise."""
    training_steps: int = 100
    """Levels of noise."""
    inference_steps: int = 10
    """Denoising steps of an inference, at most `training_steps`."""
    beta_start: float = 1e-4
    """First variance of the schedule."""
    beta_end: float = 0.02
    """Last variance of the schedule; the squared cosine schedule does not use it, others would."""
    beta_schedule: Literal["squaredcos_cap_v2", "linear"] = "squaredcos_cap_v2"
    """How the variance grows."""

    def __post_init__(self) -> None:
        if not 1 <= self.inference_steps <= self.training_steps:
            raise ValueError(
                f"inference_steps must lie in 1 ... {self.training_steps}; got {self.inference_steps}"
            )


@dataclass(frozen=True, kw_only=True)
class PointsConfig:
    """A cloud seen point by point: layers of each point, the maximum over them, one layer."""

    points: int
    """Points taken from the cloud."""
    widths: tuple[int, ...]
    """Channels of the layers of a point."""
    features: int
    """Length of the cloud's feature."""
    use_color: bool = False
    """Whether colour is observed beside position; the cloud must have it."""

    def __post_init__(self) -> None:
        _check_positive(self, "points", "features")
        _check_widths("widths", self.widths)


@dataclass(frozen=True, kw_only=True)
class LevelConfig:
    """One level of PointNet++: centres, and a network over the neighbours of each."""

    centres: int
    """Centres; 0 gathers all points into one group."""
    radius: float
    """Largest distance of a neighbour, in the normalised frame (garments lie within [-1, 1])."""
    neighbours: int
    """Neighbours of a centre."""
    widths: tuple[int, ...]
    """Channels of the layers."""

    def __post_init__(self) -> None:
        _check_widths("widths", self.widths)
        if self.centres and not (self.centres > 0 and self.radius > 0 and self.neighbours > 0):
            raise ValueError(
                "a level with centres needs a radius and neighbours > 0; "
                f"got centres {self.centres}, radius {self.radius}, neighbours {self.neighbours}"
            )


@dataclass(frozen=True, kw_only=True)
class GarmentConfig:
    """The garment with its affordance, seen by a PointNet++ that ends in one feature."""

    points: int
    """Points taken from the cloud."""
    levels: tuple[LevelConfig, ...]
    """Levels, fine to coarse; the last one, and it alone, has no centres."""
    features: int
    """Length of the garment's feature."""
    use_affordance: bool = True
    """Whether the affordance channels are observed; without them there is nothing for a matcher to say."""

    def __post_init__(self) -> None:
        _check_positive(self, "points", "features")
        centres = [level.centres for level in self.levels]
        if not centres or centres[-1] != 0 or 0 in centres[:-1]:
            raise ValueError(f"of the levels only the last has no centres; got {centres}")
        if any(a <= b for a, b in zip([self.points, *centres], centres, strict=False)):
            raise ValueError(f"levels must have fewer and fewer of {self.points}; got {centres}")


@dataclass(frozen=True, kw_only=True)
class ImageConfig:
    """The environment camera's picture, seen by a residual network of 18 layers."""

    height: int
    """Rows that pictures are scaled to [pixel]."""
    width: int
    """Columns that pictures are scaled to [pixel]."""
    widths: tuple[int, int, int, int]
    """Channels of the four stages, multiples of 16; the last is the length of the picture's feature."""

    def __post_init__(self) -> None:
        if self.height < 32 or self.width < 32:
            raise ValueError(f"height and width must be >= 32; got {self.height} x {self.width}")
        if len(self.widths) != 4 or any(width < 16 or width % 16 for width in self.widths):
            raise ValueError(f"widths must be four multiples of 16; got {self.widths}")


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """One diffusion policy: horizons, sizes, and an encoder for each thing that it observes."""

    method: Method
    """Which policy it is; decides which of the encoders below are there."""
    unet: UNetConfig
    """The denoising network."""
    diffusion: DiffusionConfig
    """The noise."""
    state: tuple[int, ...]
    """Widths of the joint state's layers with ReLU between them; none passes the normalised state on."""
    relative_joints: tuple[int, ...]
    """Joints, ascending, whose targets are learned relative to where they were when the stage began; those of all others
    are learned as they are. How far they have come since then is observed beside the joint state."""
    environment: PointsConfig | None = None
    """Environment cloud, in every observation."""
    garment: GarmentConfig | None = None
    """Garment cloud and affordance, once a stage."""
    object: PointsConfig | None = None
    """Object cloud, once a stage."""
    image: ImageConfig | None = None
    """Picture, in every observation."""
    joints: int = 60
    """Joints of the robot, and length of an action."""
    horizon: int = 8
    """Predicted actions. Source: paper."""
    observation_steps: int = 3
    """Observations that a prediction sees. Source: paper."""
    action_steps: int = 4
    """Executed actions, from the last observation's on. Source: paper."""

    def __post_init__(self) -> None:
        if self.method not in get_args(Method):
            raise ValueError(f"method must be one of {get_args(Method)}; got {self.method!r}")
        _check_positive(self, "joints", "horizon", "observation_steps", "action_steps")
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
        if self.state:
            _check_widths("state", self.state)
        allowed = range(self.joints)
        if [*self.relative_joints] != [joint for joint in allowed if joint in self.relative_joints]:
            raise ValueError(
                f"relative_joints must ascend within 0 ... {self.joints - 1}; got {self.relative_joints}"
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
        """Which of the predicted actions are executed: indices 2 ... 5 as published."""
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
        return from_plain(cls, json.loads(text))


ARM_JOINTS = (*range(6), *range(30, 36))
"""Joints of both arms, left and right, among the 60 of the robot."""
_ENCODERS = ("environment", "garment", "object", "image")
_OBSERVED: Mapping[str, set[str]] = {
    "sadp": {"environment", "garment", "object"},
    "sadp-g": {"environment", "garment"},
    "dp3": {"environment"},
    "dp": {"image"},
}


def from_plain(cls: type[C], values: Any) -> C:
    """Build a configuration from plain values, as JSON holds them.

    Raises:
        ValueError: If the values are no mapping, or a field is missing, unknown or of a wrong type.
    """
    import dacite

    if not isinstance(values, dict):
        raise ValueError(f"{cls.__name__} must be an object; got {str(values)[:60]}")
    try:
        return dacite.from_dict(cls, values, dacite.Config(strict=True, cast=[tuple]))
    except dacite.DaciteError as err:
        raise ValueError(f"{cls.__name__}: {' '.join(str(err).split())}") from err
    except TypeError as err:  # What cannot be cast.
        raise ValueError(f"{cls.__name__}: {err}") from err


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
                LevelConfig(centres=512, radius=0.2, neighbours=32, widths=(64, 64, 128)),
                LevelConfig(centres=128, radius=0.4, neighbours=64, widths=(128, 128, 256)),
                LevelConfig(centres=0, radius=0.0, neighbours=0, widths=(256, 256, 512)),
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
    """The same policies for a CPU: fewer points, narrower layers, the same horizons and denoising."""

    def points(features: int) -> PointsConfig:
        return PointsConfig(points=256, widths=(32, 64, 128), features=features)

    def garment(features: int) -> GarmentConfig:
        return GarmentConfig(
            points=512,
            levels=(
                LevelConfig(centres=64, radius=0.2, neighbours=16, widths=(32, 64)),
                LevelConfig(centres=16, radius=0.5, neighbours=16, widths=(64, 128)),
                LevelConfig(centres=0, radius=0.0, neighbours=0, widths=(128, 256)),
            ),
            features=features,
        )

    unet = UNetConfig(widths=(64, 128, 256), step_embedding=64)
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


def _check_positive(config: object, *names: str) -> None:
    for name in names:
        if getattr(config, name) < 1:
            raise ValueError(f"{name} must be at least 1; got {getattr(config, name)}")


def _check_widths(name: str, widths: tuple[int, ...]) -> None:
    if not widths or min(widths) < 1:
        raise ValueError(f"{name} must be positive, at least one; got {widths}")


_PRESETS: Mapping[str, Mapping[str, PolicyConfig]] = {
    "paper": _paper_presets(),
    "small": _small_presets(),
}
