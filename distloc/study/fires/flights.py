"""Flies scenes: the localizer on the masks of fires as they are, told nothing but its defaults, without the scenery.

`study scenes` calls it. What flies is tuned on seeds under 1000; the study's own start at `SEED`.
"""

from collections.abc import Callable, Sequence

from distloc.localizer import Localizer, LocalizerConfig
from distloc.study.fires.cases import CAMERA, SceneCase
from distloc.study.fires.ledger import SceneLedger, SceneTrack
from distloc.study.fires.staging import SceneRun, staged
from distloc.study.runner import run_all

SEED = 66_000
PARTICLES = 4000


def fly_all(
    cases: Sequence[SceneCase],
    runs: int,
    jobs: int,
    seed: int = SEED,
    on_done: Callable[[int], None] = lambda done: None,
    n_particles: int = PARTICLES,
    length_share: float = 1.0,
) -> list[list[SceneTrack]]:
    """Each case's runs, seeded `seed`, `seed` + 1 and so on; `on_done` gets how many flights are done."""
    tasks = [SceneRun(case, seed + number, n_particles, length_share) for case in cases for number in range(runs)]
    results = run_all(fly, tasks, jobs, on_done)
    return [results[index * runs : (index + 1) * runs] for index in range(len(cases))]


def fly(run: SceneRun) -> SceneTrack:
    """One flight."""
    stage = staged(run)
    localizer = Localizer(CAMERA, LocalizerConfig(n_particles=run.n_particles), rng=stage.filter_rng)
    ledger = SceneLedger(stage.fires)
    for frame in stage.frames:
        ledger.enter(frame, localizer.step(frame.pose, frame.mask))
    return ledger.closed()
