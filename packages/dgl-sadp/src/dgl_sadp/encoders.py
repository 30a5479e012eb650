"""From observations to the condition of the denoising network: all that policies differ by."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_sadp._clouds import Augmentation, thin_cloud
from dgl_sadp._pointnet import GarmentNet, PointsNet
from dgl_sadp._random import Draws
from dgl_sadp._resnet import ImageNet18
from dgl_sadp.config import PolicyConfig
from dgl_sadp.normalizer import Normalizer

__all__ = ["ObservationEncoder"]


class ObservationEncoder(nn.Module):
    """Encodes what a policy observes; which parts there are, the configuration says.

    What does not change within a stage (the garment with its affordance, the object) is encoded
    once, and joined to every observation. The networks' norms are the same in training and
    evaluation: a copy of the weights, such as EMA's, is a copy of the function.
    """

    _is_relative: Tensor

    def __init__(self, config: PolicyConfig) -> None:
        """Set up the parts."""
        super().__init__()
        self.config = config
        self.environment = None if config.environment is None else PointsNet(config.environment)
        self.garment = None if config.garment is None else GarmentNet(config.garment)
        self.object = None if config.object is None else PointsNet(config.object)
        self.image = None if config.image is None else ImageNet18(config.image)
        layers: list[nn.Module] = []
        width = config.joints + len(config.relative_joints)
        for following in config.state:
            layers += [nn.ReLU()] if layers else []
            layers += [nn.Linear(width, following)]
            width = following
        self.state = nn.Sequential(*layers)
        parts = (config.environment, config.garment, config.object)
        features = width + sum(part.features for part in parts if part is not None)
        if config.image is not None:
            features += config.image.widths[-1]
        is_relative = torch.zeros(config.joints)
        is_relative[list(config.relative_joints)] = 1.0
        self.register_buffer("_is_relative", is_relative, persistent=False)
        self.frame_features = features
        """Length of an observation's feature, with the stage's: 256 for SADP as published."""

    def find_origin(self, observation: Mapping[str, Tensor]) -> Tensor:
        """Return what targets are learned relative to [rad], shape (B, D).

        It is `start_joint_state`, shape (B, D), for `relative_joints`, and 0 for all others.
        """
        return observation["start_joint_state"] * self._is_relative

    @property
    def features(self) -> int:
        """Length of the condition: of all observations that a prediction sees, and the stage."""
        stages = self.config.stages if self.config.stages > 1 else 0
        return self.config.observation_steps * self.frame_features + stages

    def encode_stage(
        self,
        observation: Mapping[str, Tensor],
        normalizer: Normalizer,
        draws: Draws,
        augmentation: Augmentation | None = None,
    ) -> Tensor:
        """Encode the observations that stay the same in a stage, for `predict`.

        Args:
            observation: `garment_point_cloud` [m], world frame, shape (B, N, 3);
                `points_affordance_feature`, shape (B, N, 2); `object_point_cloud` [m], world frame,
                shape (B, M, 3); as far as the policy observes them.
            normalizer: Ranges of the data.
            draws: Draws which points are looked at.
            augmentation: How clouds are varied, in training.

        Returns:
            Shape (B, S); S is 0 if the policy observes nothing of the kind.
        """
        parts: list[Tensor] = []
        if self.garment is not None and self.config.garment is not None:
            cloud = observation["garment_point_cloud"]
            if self.config.garment.use_affordance:
                cloud = torch.cat([cloud, observation["points_affordance_feature"]], dim=2)
            cloud = thin_cloud(cloud, self.config.garment.points, draws, augmentation)
            positions = normalizer.of("garment_point_cloud").normalize(cloud[..., :3])
            parts.append(self.garment(torch.cat([positions, cloud[..., 3:]], dim=2)))
        if self.object is not None and self.config.object is not None:
            scaler = normalizer.of("object_point_cloud")
            cloud = observation["object_point_cloud"][..., : len(scaler.centre)]
            cloud = thin_cloud(cloud, self.config.object.points, draws, augmentation)
            parts.append(self.object(scaler.normalize(cloud)))
        if not parts:
            any_observed = next(iter(observation.values()))
            return any_observed.new_zeros((len(any_observed), 0), dtype=torch.float32)
        return torch.cat(parts, dim=1)

    def encode(
        self,
        observation: Mapping[str, Tensor],
        stage: Tensor,
        normalizer: Normalizer,
        draws: Draws,
        augmentation: Augmentation | None = None,
    ) -> Tensor:
        """Encode consecutive observations.

        Args:
            observation: `joint_state` [rad], shape (B, To, D); `start_joint_state` [rad], where the
                stage began, shape (B, D); `env_point_cloud` [m], world frame, with colour, shape
                (B, To, N, 3 or 6); `image`, shape (B, To, H, W, 3), uint8; `stage`, from 0, shape
                (B,), int64; as far as the policy observes them.
            stage: What `encode_stage` returned, shape (B, S).
            normalizer: Ranges of the data.
            draws: Draws which points are looked at.
            augmentation: How clouds are varied, in training.

        Returns:
            The condition, shape (B, features).
        """
        states = normalizer.of("joint_state").normalize(observation["joint_state"])
        batch, steps, _ = states.shape
        parts = [stage.unsqueeze(1).expand(batch, steps, -1)]
        if self.environment is not None and self.config.environment is not None:
            scaler = normalizer.of("env_point_cloud")
            cloud = observation["env_point_cloud"][..., : len(scaler.centre)]
            cloud = thin_cloud(cloud, self.config.environment.points, draws, augmentation)
            found = self.environment(scaler.normalize(cloud).flatten(0, 1))
            parts.append(found.unflatten(0, (batch, steps)))
        if self.image is not None:
            found = self.image(observation["image"].flatten(0, 1))
            parts.append(found.unflatten(0, (batch, steps)))
        # Scaled as the targets are, which are relative to the same place.
        travelled = observation["joint_state"] - self.find_origin(observation).unsqueeze(1)
        travelled = normalizer.of("action").normalize(travelled)
        relative = travelled[..., list(self.config.relative_joints)]
        parts.append(self.state(torch.cat([states, relative], dim=2)))
        condition = torch.cat(parts, dim=2).flatten(1)
        if self.config.stages == 1:
            return condition
        which = functional.one_hot(observation["stage"], self.config.stages)
        return torch.cat([condition, which.to(condition.dtype)], dim=1)
