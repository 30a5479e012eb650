"""The diffusion policy: denoises a chunk of joint targets under what was observed."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from dgl_sadp._clouds import Augmentation
from dgl_sadp._random import Draws, Share
from dgl_sadp._unet import ConditionalUNet
from dgl_sadp.config import DiffusionConfig, PolicyConfig
from dgl_sadp.encoders import ObservationEncoder
from dgl_sadp.normalizer import Normalizer

if TYPE_CHECKING:
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler
    from diffusers.schedulers.scheduling_ddpm import DDPMScheduler

__all__ = ["DiffusionPolicy"]


class DiffusionPolicy(nn.Module):
    """SADP, SADP_G, DP3 or DP: one U-Net and one loss with configured encoders.

    Targets of `config.relative_joints`, the arms', are learned relative to where the stage began:
    the hands stand exactly at the grasp points then, which a policy would otherwise have to
    reproduce from its features, centimetres off. Relative to the newest state errors would add up
    instead, chunk after chunk.

    Batches are windows as `EpisodeDataset` gives them, as tensors with a leading dimension B. Where
    something is drawn it is by a generator that the caller gives; the policy itself has no random
    state.

    Source:
        DexGarmentLab, structure-aware diffusion policy; Chi et al., "Diffusion Policy", 2023.
    """

    def __init__(self, config: PolicyConfig) -> None:
        """Set up with weights from torch's global generator and identity normalisers."""
        super().__init__()
        self.config = config
        self.normalizer = Normalizer(config)
        self.encoder = ObservationEncoder(config)
        self.unet = ConditionalUNet(
            config.unet, actions=config.joints, condition=self.encoder.features
        )
        self._scheduler = _make_scheduler(config.diffusion)

    @classmethod
    def make(cls, config: PolicyConfig, *, seed: int) -> "DiffusionPolicy":
        """Set up with weights of a seed, leaving torch's global generator as it was."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return cls(config)

    @property
    def device(self) -> torch.device:
        """Device of the weights."""
        return self.normalizer.of("action").centre.device

    def forward(
        self,
        window: Mapping[str, Tensor],
        generator: torch.Generator,
        augmentation: Augmentation | None = None,
        share: Share | None = None,
    ) -> Tensor:
        """Compute the loss of a batch: mean squared error of what the network should predict.

        Args:
            window: Batch of windows: what the configuration's `frame_keys` and `stage_keys` name,
                `start_joint_state` [rad], shape (B, D), `stage`, shape (B,), and `action` [rad],
                shape (B, T, D). Arrays of `stage_keys` may have a row for each G consecutive
                windows, of which one is encoded for all.
            generator: Draws points, noise and its levels.
            augmentation: How clouds are varied.
            share: Which rows of a batch these are; all of them when None. What is drawn for a row
                depends on its place.

        Returns:
            Scalar.
        """
        draws = Draws(generator, share)
        rows = len(window["action"])
        repeats = rows // min([rows, *(len(window[key]) for key in self.config.stage_keys)])
        shared = Draws(generator, share and share.divide(repeats))
        stage = self.encoder.encode_stage(window, self.normalizer, shared, augmentation)
        stage = stage.repeat_interleave(rows // len(stage), dim=0)
        condition = self.encoder.encode(window, stage, self.normalizer, draws, augmentation)
        origin = self.encoder.find_origin(window).unsqueeze(1)
        clean = self.normalizer.of("action").normalize(window["action"] - origin)
        noise = draws.normal(clean.shape).to(clean.device)
        levels = self.config.diffusion.training_steps
        step = draws.integers(levels, (len(clean),)).to(clean.device)
        noisy = self._scheduler.add_noise(clean, noise, step)  # type: ignore[arg-type]
        target = clean if self.config.diffusion.prediction == "sample" else noise
        predicted = self.unet(noisy, step, self.unet.project(condition))
        return functional.mse_loss(predicted, target)

    @torch.no_grad()
    def encode_stage(self, observation: Mapping[str, Tensor], generator: torch.Generator) -> Tensor:
        """Encode the observations that stay the same in a stage, for `predict`."""
        return self.encoder.encode_stage(observation, self.normalizer, Draws(generator))

    @torch.no_grad()
    def predict(
        self, observation: Mapping[str, Tensor], stage: Tensor, generator: torch.Generator
    ) -> Tensor:
        """Generate actions.

        Args:
            observation: The last To observations; see `ObservationEncoder.encode`.
            stage: What `encode_stage` returned for the stage, shape (B, S).
            generator: Draws points and noise; the same seed gives the same actions.

        Returns:
            Joint targets [rad], shape (B, T, D). `config.executed` says which of them are for
            execution.
        """
        draws = Draws(generator)
        condition = self.encoder.encode(observation, stage, self.normalizer, draws)
        projected = self.unet.project(condition)
        shape = (len(condition), self.config.horizon, self.config.joints)
        actions = draws.normal(shape).to(condition.device)
        scheduler = self._scheduler
        scheduler.set_timesteps(self.config.diffusion.inference_steps)
        for step in scheduler.timesteps:
            # The schedulers keep their steps on the CPU; the network wants one for each chunk.
            level = torch.full((len(actions),), int(step), device=actions.device)
            predicted = self.unet(actions, level, projected)
            actions = scheduler.step(
                predicted, int(step), actions, generator=generator, return_dict=False
            )[0]
        origin = self.encoder.find_origin(observation).unsqueeze(1)
        return self.normalizer.of("action").unnormalize(actions) + origin


def _make_scheduler(config: DiffusionConfig) -> "DDIMScheduler | DDPMScheduler":
    # Imported late: diffusers takes seconds to import, and reading data does not need it.
    shared = {
        "num_train_timesteps": config.training_steps,
        "beta_start": config.beta_start,
        "beta_end": config.beta_end,
        "beta_schedule": config.beta_schedule,
        "prediction_type": config.prediction,
        "clip_sample": True,
    }
    if config.scheduler == "ddim":
        from diffusers.schedulers.scheduling_ddim import DDIMScheduler

        return DDIMScheduler(**shared, set_alpha_to_one=True)
    from diffusers.schedulers.scheduling_ddpm import DDPMScheduler

    return DDPMScheduler(**shared, variance_type="fixed_small")
