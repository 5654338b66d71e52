"""Snapshots of an animated take, as Fig. 5 of Huang et al.

(a) to (f) A synthetic talking take on the built-in head, from several sides: rest, mouth widest open, broadest,
roundest, half open, brows highest. (g) The wireframe with the mouth widest open.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.scenes import XYZ, built_in_head, place_rows
from evalkit.figures.table import Table
from evalkit.render.face_figures import LETTERS, VIEWS_DEG, snapshots, telling_frames

NAME = "huang-5"
COLUMNS = ("panel", "frame", "yaw_deg", "pitch_deg", "lid_left", "lid_right", "label", *XYZ)
KERNEL, SEAM = "exponential", "ramp"
SIZE = 540
"""Pixels of a head: four of them over a page are printed at 225 dpi."""


def measure(budget: str) -> list[dict[str, Any]]:
    """Displacements of the markers on the head in the frames that are shown, and what else moves it."""
    from evalkit.animation import animate
    from evalkit.synthetic import synthesize

    take, truth = synthesize("talking", seed=0)
    made = animate(take, built_in_head(), rigid=truth.rigid, kernel=KERNEL, seam=SEAM)
    rows = []
    for letter, frame, (yaw, pitch) in zip(LETTERS, telling_frames(made), VIEWS_DEG, strict=False):
        left, right = made.lids_closed[frame].round(4).tolist()
        moved = dict(zip(made.deformation.labels, made.displacements[frame], strict=True))
        rows += place_rows(
            moved, panel=letter, frame=frame, yaw_deg=yaw, pitch_deg=pitch, lid_left=left, lid_right=right
        )
    return rows


def draw(table: Table) -> Any:
    """The figure."""
    from evalkit.animation import Animation
    from evalkit.animation.jaw import jaw_motion
    from evalkit.deform import deformation_report

    head, panels = built_in_head(), table.rows.groupby("panel", sort=True)
    first = panels.first()
    labels = list(dict.fromkeys(table.rows["label"]))
    moved = np.stack([rows.set_index("label").loc[labels, list(XYZ)].to_numpy(float) for _, rows in panels])
    sites = {name: head.marker_sites[name] for name in labels}
    count, rest = len(moved), np.array(list(sites.values()))
    jaw_deg, glide = jaw_motion(head, {name: moved[:, k] for k, name in enumerate(labels)})
    made = Animation(
        head=head, rate_hz=60.0, source_frames=first["frame"].to_numpy(float),
        deformation=deformation_report(head, sites, KERNEL, seam=SEAM), displacements=moved,
        lids_closed=first[["lid_left", "lid_right"]].to_numpy(float), jaw_deg=jaw_deg, jaw_glide_mm=glide,
        rotations=np.repeat(np.eye(3)[None], count, axis=0), translations=np.zeros((count, 3)),
        raw_markers=rest + moved, still_markers=rest + moved, pivot=None, placed={},
        held=np.zeros(count, dtype=bool), report={},
    )  # fmt: skip
    return snapshots(head, made.vertices(), list(zip(first["yaw_deg"], first["pitch_deg"], strict=True)), SIZE)
