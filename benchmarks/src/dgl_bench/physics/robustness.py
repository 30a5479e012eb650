"""Robots that flail at random on a garment."""

import numpy as np

from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, ClothView, Figure, Limit, Series
from dgl_bench.rows import Reading
from dgl_physics import ContactOverflowError, SimulationDivergedError

__all__ = ["measure_robustness"]

ACTIONS = 10_000
SHARE = 0.08
"""Share of the actions that effort 1 takes; the rest needs `--effort 12.5`."""
HOLD = 12
"""Frames for which a random goal stands."""
NOISE = 0.25
"""Standard deviation of the joints' deviation from a pose of the fold [rad]."""
IDLE = 30
"""Actions without a touch after which all starts anew: what has been thrown out of reach proves
nothing."""
TORN = 10.0
"""An edge this many times its length counts as exploded."""


def measure_robustness(bench: Bench) -> Result:
    """Both robots jump between poses near the garment, with every joint off at random."""
    record = bench.fold
    env = record.env
    count = min(bench.scale(round(SHARE * ACTIONS), least=20), ACTIONS)
    rng = np.random.default_rng([bench.seed, 9])
    near = np.concatenate([np.arange(*span) for span in record.stages.values()])
    env.reset(seed=bench.seed, options={"garment": env.garment.name})
    start = env.get_state_dict()
    diverged = overflowed = torn = touched = starts = 0
    idle = IDLE
    strains, speeds = [], []
    goal = record.actions[near[0]]
    for frame in range(count):
        if idle >= IDLE:
            env.set_state_dict(start)
            starts, idle = starts + 1, 0
        if frame % HOLD == 0:
            poses = record.actions[rng.choice(near, 2)]
            goal = np.concatenate([poses[0, :30], poses[1, 30:]])
            goal = (goal + rng.normal(0, NOISE, 60)).astype(np.float32)
        try:
            env.advance(goal)
        except SimulationDivergedError:
            diverged += 1
        except ContactOverflowError:
            overflowed += 1
        else:
            strain, velocities = env.cloth.measure_strain(), env.cloth.state.get_velocities()
            strains.append(100 * float(strain.max()))
            speeds.append(float(np.linalg.norm(velocities, axis=-1).max()))
            torn += bool(strain.max() > TORN - 1)
            is_touching = env.count_touching() > 0
            touched += is_touching
            idle = 0 if is_touching else idle + 1
            continue
        idle = IDLE
    note = f"{count} of {ACTIONS:,} random actions" + (
        "" if count == ACTIONS else f"; --effort {1 / SHARE:g} makes all"
    )
    rows = (
        Reading(
            "flailing robots, actions during which they touch the garment",
            100 * touched / count,
            "%",
            note=f"{starts} starts: a new one after {IDLE} actions without a touch",
        ),
        Reading("flailing robots, diverged", diverged, "times", bar="<= 0", note=note),
        Reading("flailing robots, contacts that overflowed", overflowed, "times", bar="<= 0"),
        Reading(
            f"flailing robots, frames with an edge longer than {TORN:g} times",
            torn,
            "frames",
            bar="<= 0",
            note="counts as an explosion",
        ),
        Reading(
            "flailing robots, largest strain of an edge",
            max(strains, default=None),
            "%",
            note="" if strains else "no frame succeeded",
        ),
        Reading(
            "flailing robots, fastest particle",
            max(speeds, default=None),
            "m/s",
            note=f"speeds are bounded by {env.cloth.config.max_speed:g} m/s",
        ),
    )
    t = np.arange(len(strains)) / 60
    figure = Figure(
        "robustness",
        f"Both robots go to random poses near the garment, all 60 joints off by {NOISE} "
        "rad (standard "
        f"deviation), a new goal every 0.2 s, and a new start after {IDLE / 60:g} s without a "
        "touch. Left: the garment at the end. "
        "Right: its largest strain and speed.",
        (
            ClothView(
                f"after {count} random actions",
                env.get_particles(),
                env.garment.faces,
                azimuth=-90,
                elevation=50,
            ),
            Chart(
                f"largest strain {max(strains, default=0):.0f} %",
                "simulated time [s]",
                "largest strain of an edge [%]",
                (Series(t, strains, tone=1),),
                limits=(Limit(100 * (TORN - 1), "explosion"),),
                is_log_y=True,
            ),
            Chart(
                f"fastest particle {max(speeds, default=0):.1f} m/s",
                "simulated time [s]",
                "fastest particle [m/s]",
                (Series(t, speeds),),
                limits=(Limit(env.cloth.config.max_speed, "bound of the solver", is_quiet=True),),
            ),
        ),
    )
    return Result(rows, (figure,))
