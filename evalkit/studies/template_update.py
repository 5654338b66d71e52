"""How the cylinder's template is kept up to date, over short and long videos.

Question: what do a template that follows the last frame and references that undo its drift gain over the first frame?

Finding: not measured yet, since the study is younger than its tracker; the command prints the figures.

Command: ``evalkit study run template-update --budget full``
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from evalkit.studies.filmed import FilmedHead, VideoParameters, film
from evalkit.studies.takes import told
from evalkit.studies.tracked import (
    POSE_COLUMNS,
    POSE_STATISTICS,
    Tracked,
    heads_here,
    score_pose,
    track,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Scalar, Study
from evalkit.study.statistics import relative_to
from evalkit.vision.tracker import HeadTracker

METHODS = ("static", "dynamic", "references")

LIGHT = {"camera": ("camera", 0.0), "flicker": ("lamp", 0.15)}


def conditions(axes: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Condition]:
    """All combinations of the heads that are here."""
    for head in heads_here("template-update", axes["head"]):
        for light in axes["light"]:
            for frames in axes["frames"]:
                yield {"head": head, "light": light, "frames": frames}


def prepare(seed: int, head: str, light: str, frames: int) -> FilmedHead:
    """The video of a cell."""
    lit, flicker = LIGHT[light]
    return film(VideoParameters(head=head, light=lit, flicker=flicker, frames=frames), seed)


def run(data: FilmedHead, method: str) -> Tracked:
    """Poses of every frame."""

    def build() -> HeadTracker:
        from evalkit.vision.cylinder import CylinderTracker, Settings

        return CylinderTracker(Settings(update=method))  # type: ignore[arg-type]

    return track(build, data)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="template-update",
    question=QUESTION,
    finding=FINDING,
    axes={"head": ("photo", "makehuman-photo"), "light": tuple(LIGHT), "frames": (90, 450)},
    methods=METHODS,
    prepare=prepare,
    run=run,
    score=score_pose,
    columns=POSE_COLUMNS,
    statistics=(*POSE_STATISTICS, relative_to("late_deg", "dynamic", "last third over dynamic's")),
    full=Budget(seeds=3),
    small=Budget(seeds=1, axes={"head": ("template-small",), "light": ("camera",), "frames": (30,)}),
    conditions=conditions,
)

if __name__ == "__main__":
    script(study)
