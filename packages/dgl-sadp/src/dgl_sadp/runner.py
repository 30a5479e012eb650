"""Runner of a policy: queued observations, stage features, chunks of joint targets."""

from collections import deque
from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from dgl_sadp.errors import ObservationError
from dgl_sadp.policy import DiffusionPolicy

__all__ = ["PolicyRunner"]

# Key -> shape of an observation; None is any size, at least 1. Joints are checked by the policy's
# own number.
_SHAPES: Mapping[str, tuple[int | None, ...]] = {
    "joint_state": (None,),
    "env_point_cloud": (None, None),
    "image": (None, None, 3),
    "garment_point_cloud": (None, 3),
    "points_affordance_feature": (None, 2),
    "object_point_cloud": (None, 3),
}


class PolicyRunner:
    """Runs one stage of a policy in one environment.

    `reset` begins a stage; `act` returns the joint targets to execute. Each executed target gives
    one observation: `observe` takes all but the last, the next `act` takes the last. The policy
    then sees consecutive frames, each once, as in training::

        runner.reset(observation)
        for _ in range(chunks):
            targets = runner.act(observation)
            for target in targets[:-1]:
                runner.observe(execute(target))
            observation = execute(targets[-1])

    Observations are dictionaries of arrays with the keys of episode files, without a leading
    dimension; other keys are ignored. Clouds may have any number of points.
    """

    def __init__(self, policy: DiffusionPolicy, *, stage: int = 1, seed: int = 0) -> None:
        """Take a policy, on the device where it is.

        Args:
            policy: Used in evaluation mode.
            stage: Number of the stage, from 1.
            seed: Of everything drawn, unless `reset` is given another.

        Raises:
            ValueError: If the policy has no such stage.
        """
        if not 1 <= stage <= policy.config.stages:
            raise ValueError(f"stage must lie in 1 ... {policy.config.stages}; got {stage}")
        self.policy = policy.eval()
        self.stage = stage
        self.seed = seed
        self._frames: deque[dict[str, Tensor]] = deque(maxlen=policy.config.observation_steps)
        self._generator = torch.Generator()
        self._stage: Tensor | None = None
        self._start: Tensor | None = None
        self._since_act = 0
        self._has_acted = False

    @property
    def action_steps(self) -> int:
        """Joint targets of one chunk."""
        return self.policy.config.action_steps

    def reset(self, observation: Mapping[str, np.ndarray], *, seed: int | None = None) -> None:
        """Begin a stage: forget past observations and encode the stage.

        Args:
            observation: `garment_point_cloud` [m], world frame, shape (N, 3);
                `points_affordance_feature` in [0, 1], shape (N, 2); `object_point_cloud` [m], world
                frame, shape (M, 3); those that the policy observes.
            seed: Of everything drawn until the next reset; the same seed and observations give the
                same targets.

        Raises:
            ObservationError: If something is missing, of another shape or not finite.
        """
        self._frames.clear()
        self._since_act, self._has_acted, self._start = 0, False, None
        self._generator.manual_seed(self.seed if seed is None else seed)
        config = self.policy.config
        arrays = _check(observation, config.stage_keys, config.joints)
        if "points_affordance_feature" in arrays:
            points, rows = (
                len(arrays[key]) for key in ("garment_point_cloud", "points_affordance_feature")
            )
            if points != rows:
                raise ObservationError(
                    f"points_affordance_feature must have a row for each of the {points} garment "
                    f"points; got {rows}"
                )
        tensors = {key: tensor.unsqueeze(0) for key, tensor in self._move(arrays).items()}
        if not tensors:  # Nothing of the kind is observed: the feature has no channels.
            tensors = {"joint_state": torch.zeros(1, config.joints, device=self.policy.device)}
        self._stage = self.policy.encode_stage(tensors, self._generator)

    def observe(self, observation: Mapping[str, np.ndarray]) -> None:
        """Append the observation that follows an executed target.

        Raises:
            ObservationError: If something is missing, of another shape or not finite, or if more
                observations come than targets were given.
            RuntimeError: Before `reset`.
        """
        self._append(observation)

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Append an observation and generate the next joint targets.

        Args:
            observation: `joint_state` [rad], shape (D,); `env_point_cloud` [m], world frame, with
                colour in [0, 1], shape (N, 6), or (N, 3) for policies that see no colour; `image`,
                shape (H, W, 3), uint8; those that the policy observes. At the start of a stage
                it stands for the observations before it too, and says where the arms begin.

        Returns:
            Joint targets [rad], shape (action_steps, D), float32, to be executed one after another.

        Raises:
            ObservationError: If something is missing, of another shape or not finite, or if there
                was not one observation for each executed target.
            RuntimeError: Before `reset`.
        """
        expected = self.action_steps
        if self._has_acted and self._since_act != expected - 1:
            raise ObservationError(
                f"act needs one observation for each of the {expected} executed targets: "
                f"{expected - 1} by observe, then its own; got {self._since_act} by observe"
            )
        self._append(observation)
        assert self._stage is not None
        config = self.policy.config
        frames = list(self._frames)
        frames = [frames[0]] * (config.observation_steps - len(frames)) + frames
        stacked = self._stack(frames)
        assert self._start is not None
        stacked["start_joint_state"] = self._start.unsqueeze(0)
        stacked["stage"] = torch.tensor([self.stage - 1], device=self.policy.device)
        actions = self.policy.predict(stacked, self._stage, self._generator)[0, config.executed]
        self._since_act, self._has_acted = 0, True
        return actions.cpu().numpy()

    def _append(self, observation: Mapping[str, np.ndarray]) -> None:
        if self._stage is None:
            raise RuntimeError("reset must be called before observe and act")
        if self._since_act >= (self.action_steps if self._has_acted else 1):
            raise ObservationError(
                "one observation for each executed target is taken; got more than "
                f"{self._since_act}"
            )
        config = self.policy.config
        arrays = _check(observation, config.frame_keys, config.joints)
        cloud = arrays.get("env_point_cloud")
        if cloud is not None:
            channels = len(self.policy.normalizer.of("env_point_cloud").centre)
            arrays["env_point_cloud"] = cloud[:, :channels]
            if cloud.shape[1] < channels:
                raise ObservationError(
                    f"env_point_cloud must have {channels} channels; got shape {cloud.shape}"
                )
        moved = self._move(arrays)
        if self._start is None:
            self._start = moved["joint_state"]
        self._frames.append(moved)
        self._since_act += 1

    def _move(self, arrays: Mapping[str, np.ndarray]) -> dict[str, Tensor]:
        # Copied: the environment may use its arrays again.
        device = self.policy.device
        return {key: torch.from_numpy(array.copy()).to(device) for key, array in arrays.items()}

    def _stack(self, frames: list[dict[str, Tensor]]) -> dict[str, Tensor]:
        """Join consecutive observations: arrays of shape (1, To, ...)."""
        stacked: dict[str, Tensor] = {}
        for key in frames[0]:
            parts = [frame[key] for frame in frames]
            if key == "env_point_cloud":
                # Clouds may differ in size: each brings as many points as the largest, repeating
                # its own.
                most = max(len(part) for part in parts)
                parts = [part[torch.arange(most, device=part.device) % len(part)] for part in parts]
            stacked[key] = torch.stack(parts).unsqueeze(0)
        return stacked


def _check(
    observation: Mapping[str, np.ndarray], keys: tuple[str, ...], joints: int
) -> dict[str, np.ndarray]:
    missing = [key for key in keys if key not in observation]
    if missing:
        raise ObservationError(f"the observation must have {list(keys)}; missing {missing}")
    arrays: dict[str, np.ndarray] = {}
    for key in keys:
        array = np.asarray(observation[key])
        wanted = (joints,) if key == "joint_state" else _SHAPES[key]
        fits = len(array.shape) == len(wanted) and all(
            size >= 1 if want is None else size == want
            for want, size in zip(wanted, array.shape, strict=True)
        )
        if key == "env_point_cloud":
            fits = fits and array.shape[1] in (3, 6)
            wanted = (None, 6)
        if not fits:
            shape = tuple("any" if size is None else size for size in wanted)
            raise ObservationError(f"{key} must have shape {shape}; got {array.shape}")
        if key == "image":
            if array.dtype != np.uint8:
                raise ObservationError(f"image must be uint8; got {array.dtype}")
            arrays[key] = array
            continue
        if array.dtype.kind not in "fiu":
            raise ObservationError(f"{key} must be numbers; got {array.dtype}")
        arrays[key] = array.astype(np.float32)
        if not np.isfinite(arrays[key]).all():
            raise ObservationError(f"{key} must be finite; got NaN or infinity")
    return arrays
