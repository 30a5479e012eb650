"""Train a policy on a synthetic task and let it act with a matcher, as HALO does.

Example: python examples/train_and_run.py runs/made_up
"""

import dataclasses
import sys
from pathlib import Path

from dgl_sadp import PolicyRunner, get_policy_config, get_train_config, load_policy, train_policy
from dgl_sadp.synthetic import SyntheticEnvironment, SyntheticMatcher, write_synthetic_episodes


def main(out: Path, *, episodes: int = 40, epochs: int = 30, runs: int = 10) -> dict[str, float]:
    """Return the hands' distance from their goals [m], before and after the policy acts."""
    frames, points = 16, 512
    write_synthetic_episodes(out / "episodes", episodes, frames=frames, points=points)
    training = dataclasses.replace(get_train_config("sadp-g"), epochs=epochs)
    result = train_policy(out / "episodes", out / "run", get_policy_config("sadp-g"), training)

    # The demonstration: one sheet, and where its hands went.
    environment = SyntheticEnvironment(frames=frames, points=points)
    demonstrated = environment.see_stage()["garment_point_cloud"], environment.goals
    places = environment.places
    matcher, runner = SyntheticMatcher(), PolicyRunner(load_policy(result.policy))
    before, after = 0.0, 0.0
    for seed in range(1000, 1000 + runs):
        # A sheet that lies elsewhere; its hands should go to the same places on it.
        environment.reset(seed=seed, places=places)
        before += environment.compute_error() / runs
        seen = environment.see_stage()
        _, similarity = matcher.match(*demonstrated, seen["garment_point_cloud"])
        runner.reset({**seen, "points_affordance_feature": similarity.T}, seed=seed)
        observation = environment.observe()
        for _ in range(frames // runner.action_steps + 1):
            targets = runner.act(observation)
            for target in targets[:-1]:
                runner.observe(environment.execute(target))
            observation = environment.execute(targets[-1])
        after += environment.compute_error() / runs
    return {"before": before, "after": after}


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python train_and_run.py FOLDER")
    print(main(Path(sys.argv[1])))
