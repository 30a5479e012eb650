"""Tasks of dexgarmentlab for LeRobot: `--env.type=dexgarmentlab --env.task=FoldTops-v1`.

Importing this module registers the configuration with LeRobot and the environments
`gym_dexgarmentlab/TASK` with Gymnasium.
"""

from lerobot_env_dexgarmentlab.config import DexGarmentLabEnv as DexGarmentLabEnv
