"""No hole is seen through mouth or eyes, from any side, at any opening; drawn and counted in pixels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.ndimage import label

from evalkit.cli import app
from evalkit.errors import EvalkitError
from evalkit.head import Head, load_head
from evalkit.render.head_views import View, draw_head, head_sheet_png
from evalkit.render.offscreen import offscreen_plotter, require_offscreen

POSES = [(0.0, 0.0), (6.0, 0.5), (15.0, 1.0), (30.0, 0.8)]
"""Jaw in degrees and closing of the lids."""

SIDES = [(0.0, 0.0), (28.0, 0.0), (-28.0, 12.0), (12.0, -15.0)]
"""Yaw and pitch of the camera, degrees."""

VIEWS = [View(*SIDES[(k + turn) % 4], *pose, zoom=1.3) for turn in (0, 1) for k, pose in enumerate(POSES)]
"""Within the 30 degrees for which the head is meant, closed to wide open: every pose from two sides."""


@pytest.fixture(scope="module")
def drawing() -> None:
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))


def holes(head: Head, views: list[View] = VIEWS) -> int:
    """Pixels of background that the head encloses, over all views.

    The plate is left out since it would cover holes, the ears since what is seen between lobe and cheek is none;
    surfaces are drawn from their outer side only, so that a hole in front does not show the skin behind it.
    """
    count = 0
    for view in views:
        with offscreen_plotter(400, 400) as plotter:
            plotter.set_background("#ff00ff")
            draw_head(plotter, head, view, without=("plate", "ears"), flat="#808080")
            image = np.asarray(plotter.screenshot(None, return_img=True)).astype(int)
        background = np.abs(image - [255, 0, 255]).sum(axis=2) < 120
        pieces, _ = label(background)
        outside = np.unique(np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]]))
        count += int((background & ~np.isin(pieces, outside)).sum())
    return count


def test_nothing_is_seen_through_mouth_and_eyes(drawing):
    assert holes(load_head()) == 0


def without_last_faces(head: Head, part: str, keep: int) -> Head:
    """A head whose part has only its first triangles left."""
    first, last = head.parts[part]
    triangles = head.triangles.copy()
    triangles[first + keep : last] = triangles[first]
    return dataclasses.replace(head, triangles=triangles)


@pytest.mark.parametrize("part", ["mouth pocket", "eyeballs"])
def test_control_without_what_closes_them_the_background_is_seen(drawing, part):
    assert holes(without_last_faces(load_head(), part, 1), VIEWS[:1] + VIEWS[6:8]) > 50


def test_command_writes_the_head_and_its_pictures(drawing, tmp_path):
    done = CliRunner().invoke(app, ["head", "new", "-o", str(tmp_path), "--vertices", "2500"])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["head.npz", "head.png"]
    done = CliRunner().invoke(app, ["head", "check", str(tmp_path / "head.npz")])
    assert done.exit_code == 0 and "nothing wrong" in done.output


def test_a_picture_that_cannot_be_written_is_one_line(drawing, tmp_path):
    with pytest.raises(EvalkitError, match="cannot write the picture"):
        head_sheet_png(load_head(vertices=1_000), tmp_path / "no" / "x.png", views=(View(),), columns=1, size=64)


def test_check_of_a_bad_head_exits_with_one(tmp_path):
    head = load_head(vertices=1_000)
    dataclasses.replace(head, landmarks={}).save(tmp_path / "bad.npz")
    done = CliRunner().invoke(app, ["head", "check", str(tmp_path / "bad.npz")])
    assert done.exit_code == 1 and "missing landmarks" in done.output
