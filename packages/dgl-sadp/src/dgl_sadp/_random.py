"""Seeds of what a training draws."""

import numpy as np

# What numbers are drawn for; part of each seed.
ORDER, STEP, VALIDATION = 1, 2, 3


def draw_seed(seed: int, purpose: int, number: int) -> int:
    """Return a seed for one thing that is drawn, unlike those of all others."""
    return int(np.random.SeedSequence([seed, purpose, number]).generate_state(1, np.uint64)[0] >> 1)
