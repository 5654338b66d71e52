"""The feature-point editor: what editing does to the points, who may talk to the page, and a person at work on it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evalkit.editor.editing import Editing
from evalkit.errors import EvalkitError
from evalkit.head.photo import Photo, read_photo
from evalkit.head.points import POINTS, REQUIRED, read_points

WIDE, HIGH = 400, 480
EYES = [(170.0, 215.0), (230.0, 215.0)]
"""Middles of the right and the left eye in :func:`portrait`, to a pixel or two."""


def photo_of(size=(WIDE, HIGH)):
    return Photo(np.zeros((size[1], size[0], 3), np.uint8), size, "a.png", "0" * 64)


def begun():
    editing = Editing(photo_of())
    for eye in EYES:
        editing.put(eye)
    return editing


def test_two_clicks_give_a_whole_face_to_drag():
    editing = Editing(photo_of())
    assert (editing.next, editing.missing[: len(REQUIRED)]) == ("pupil right", list(REQUIRED))
    assert editing.put(EYES[0]) == "pupil right"
    assert editing.next == "pupil left"
    assert editing.put(EYES[1]) == "pupil left"
    assert set(editing.places) == set(POINTS)
    assert editing.next is None and editing.missing == []
    with pytest.raises(EvalkitError, match="all points are placed"):
        editing.put((1.0, 1.0))
    # The face is upright between the eyes, mouth below them.
    assert editing.places["chin"][0] == pytest.approx(200.0)
    assert editing.places["chin"][1] > editing.places["nose tip"][1] > EYES[0][1]


def test_a_point_taken_away_is_the_next_to_place():
    editing = begun()
    editing.remove("forehead")
    editing.remove("nose tip")
    # One that a fit needs comes first, whatever was taken away last.
    assert editing.missing == ["nose tip", "forehead"]
    assert editing.put((200.0, 250.0)) == "nose tip"
    assert editing.put((200.0, 100.0), "forehead") == "forehead"


@pytest.mark.parametrize("roll_deg", [0.0, 20.0])
def test_both_sides_move_as_in_a_mirror(roll_deg):
    turn = np.deg2rad(roll_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    eyes = [rotation @ (np.array(eye) - 200.0) + 200.0 for eye in EYES]
    editing = Editing(photo_of())
    for eye in eyes:
        editing.put(eye)
    editing.symmetric = True
    before = editing.places
    shift = np.array([6.0, -3.0])
    editing.move("mouth corner left", before["mouth corner left"] + rotation @ shift)
    # In the face's own axes: as far outward and as far up on the other side.
    moved = editing.places["mouth corner right"] - before["mouth corner right"]
    np.testing.assert_allclose(rotation.T @ moved, [-6.0, -3.0], atol=1e-6)
    others = set(before) - {"mouth corner left", "mouth corner right"}
    assert all(np.array_equal(before[name], editing.places[name]) for name in others)
    # Control: alone, the other side stays.
    editing.symmetric = False
    at = editing.places["mouth corner right"]
    editing.move("mouth corner left", before["mouth corner left"])
    assert np.array_equal(editing.places["mouth corner right"], at)


def test_eyes_in_one_place_do_not_stop_the_mirror():
    editing = begun()
    for name in ("pupil left", "pupil right"):
        editing.move(name, (0.0, 0.0))
    editing.symmetric = True
    before = editing.places["brow inner right"]
    editing.move("brow inner left", (230.0, 190.0))
    assert np.isfinite(list(editing.places.values())).all()
    assert not np.array_equal(editing.places["brow inner right"], before)


@given(
    st.lists(st.tuples(st.sampled_from(POINTS), st.floats(-50, 500), st.floats(-50, 500), st.booleans()), max_size=12)
)
def test_taking_every_step_back_gives_the_start_and_again_the_end(steps):
    editing = begun()
    start = editing.places
    for name, x, y, both in steps:
        editing.symmetric = both
        editing.move(name, (x, y))
    end = editing.places
    assert all((place >= 0).all() and (place <= (WIDE, HIGH)).all() for place in end.values())
    for _ in steps:
        assert editing.undo()
    assert all(np.array_equal(start[name], editing.places[name]) for name in POINTS)
    while editing.redo():
        pass
    assert all(np.array_equal(end[name], editing.places[name]) for name in POINTS)


def test_a_new_step_forgets_what_was_taken_back():
    editing = begun()
    editing.move("chin", (200.0, 400.0))
    editing.undo()
    assert editing.can_redo
    editing.move("chin", (200.0, 390.0))
    assert not editing.can_redo and not editing.redo()


def test_saved_points_are_read_back(tmp_path):
    editing = begun()
    editing.remove("chin")
    editing.save(tmp_path / "points.json")
    other = Editing(photo_of())
    other.load(tmp_path / "points.json")
    assert other.missing == ["chin"]
    for name, place in other.places.items():
        np.testing.assert_allclose(place, editing.places[name], atol=1e-3)
    with pytest.raises(EvalkitError, match="another photo"):
        Editing(photo_of((WIDE + 1, HIGH))).load(tmp_path / "points.json")


@pytest.fixture(scope="module")
def portrait(tmp_path_factory):
    """A picture of the built-in head as a photo."""
    from PIL import Image

    from evalkit.head import load_head
    from evalkit.render.head_scene import HeadScene

    head = load_head("template", vertices=5000)
    path = tmp_path_factory.mktemp("portrait") / "me.png"
    with HeadScene(head, (WIDE, HIGH), multisamples=4) as scene:
        Image.fromarray(np.ascontiguousarray(scene.frame(head.vertices))).save(path)
    return path


def test_the_preview_opens_the_mouth_of_a_head_that_can_and_leaves_others(portrait):
    from dataclasses import replace

    from evalkit.editor.preview import Preview
    from evalkit.head import load_head

    photo = read_photo(portrait)
    editing = Editing(photo)
    for eye in EYES:
        editing.put(eye)
    head = load_head("template", vertices=5000)
    for generic, opens in ((head, True), (replace(head, jaw=None), False)):
        preview = Preview(photo, generic)
        preview.fit(editing.points())
        assert (preview.picture(mouth=1.0) != preview.picture()) == opens
        assert preview.picture(yaw_deg=20.0) != preview.picture()
        preview.close()


@pytest.fixture(scope="module")
def address(portrait):
    """Of the editor's page, served by the command line."""
    command = [sys.executable, "-m", "evalkit", "head", "edit", str(portrait), "--no-browser"]
    environment = {**os.environ, "EVALKIT_LANDMARKER": "", "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, cwd=portrait.parent
    )
    line = process.stdout.readline().strip()
    assert line.startswith("http://127.0.0.1:"), line + process.stdout.read()
    yield line
    process.send_signal(signal.SIGINT)
    rest = process.communicate(timeout=30)[0]
    # Bokeh may complain of a visitor without a ticket; nothing of it went wrong in here.
    assert "evalkit/editor" not in rest, rest


def asked(address, **headers):
    """Status of an answer."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_only_who_knows_the_token_gets_an_answer(address):
    scheme, _, host, token, route = address.split("/")
    root = f"{scheme}//{host}"
    assert len(token) >= 32
    assert asked(address) == 200
    for path in ("", f"/{route}", f"/{token[:-1]}x/{route}", f"/{route}/ws", "/static/js/bokeh.min.js"):
        assert asked(root + path) == 404, path


def test_other_origins_are_refused(address):
    from websocket import WebSocketBadStatusException, create_connection

    host = address.split("/")[2]
    assert asked(address, Origin=f"http://{host}") == 200
    assert asked(address, Origin="http://example.org") == 403
    # A name that its owner lets point to this machine.
    assert asked(address, Host=f"example.org:{host.rpartition(':')[2]}") == 403
    socket = address.replace("http://", "ws://") + "/ws"
    with pytest.raises(WebSocketBadStatusException, match="403"):
        create_connection(socket, origin="http://example.org", timeout=10)
    with pytest.raises(WebSocketBadStatusException, match="404"):
        create_connection(socket.replace(address.split("/")[3], "guess"), origin=f"http://{host}", timeout=10)
    # Control: the page's own origin is let in.
    create_connection(socket, origin=f"http://{host}", timeout=10, subprotocols=["bokeh", "no-ticket"]).close()


POINTS_ON_PAGE = """(() => {
  const models = [...Bokeh.documents[0]._all_models.values()];
  return models.find(m => m.type == "ColumnDataSource" && m.data.name !== undefined).data; })()"""

FRAME = """(() => {
  const find = view => {
    if (view.model && view.model.type == "Figure") return view;
    for (const child of [...(view.child_views || []), ...(view._child_views ? view._child_views.values() : [])]) {
      const found = find(child);
      if (found) return found;
    }
  };
  for (const root of Object.values(Bokeh.index)) {
    const view = find(root);
    if (view && view.frame) {
      const around = view.el.getBoundingClientRect(), frame = view.frame.bbox;
      return [around.left + frame.left, around.top + frame.top, frame.width, frame.height];
    }
  } })()"""

TEXT = """(() => { const all = [];
  const walk = node => { if (node.shadowRoot) walk(node.shadowRoot);
    for (const child of node.childNodes) child.nodeType == 3 ? all.push(child.data) : walk(child); };
  walk(document.body); return all.join(" "); })()"""

PICTURE = """(() => { let found = "";
  const walk = node => { if (node.shadowRoot) walk(node.shadowRoot);
    for (const child of node.children) { if (child.tagName == "IMG") found = child.src; walk(child); } };
  walk(document.body); return found; })()"""


def button(name):
    """Where the middle of a button is, as a script."""
    return f"""(() => {{ let at = null;
      const walk = node => {{ if (node.shadowRoot) walk(node.shadowRoot);
        for (const child of node.children) {{
          if (child.tagName == "BUTTON" && child.textContent.trim() == "{name}") {{
            const box = child.getBoundingClientRect(); at = [box.x + box.width / 2, box.y + box.height / 2]; }}
          walk(child); }} }};
      walk(document.body); return at; }})()"""


def test_a_person_places_points_saves_reloads_and_sees_the_head(address, portrait):
    from devtools import Page

    saved = portrait.with_suffix(".points.json")
    with Page(address) as page:
        wide = page.wait(f"window.Bokeh && Bokeh.documents.length && {FRAME}")[2]

        def on_page(place):
            # Asked anew each time: the page moves while it is built.
            left, top, wide, high = page.value(FRAME)
            return left + place[0] * wide / WIDE, top + place[1] * high / HIGH

        page.wait(f"{TEXT}.includes('right eye')")
        page.click(*on_page(EYES[0]))
        page.wait(f"{TEXT}.includes('left eye')")
        page.click(*on_page(EYES[1]))
        page.wait(f"{POINTS_ON_PAGE}.name.length == {len(POINTS)}")
        first = page.wait(PICTURE, 120)
        data = page.value(POINTS_ON_PAGE)
        before = {name: (x, y) for name, x, y in zip(data["name"], data["x"], data["y"], strict=True)}
        dragged = {"chin": (0.0, 12.0), "mouth corner left": (9.0, 0.0)}
        for name, shift in dragged.items():
            # Held still for longer than a press, as careful hands do.
            page.drag(on_page(before[name]), on_page(np.add(before[name], shift)), held_s=0.5)
            page.wait(f"{PICTURE} != '{first}'", 120)
            first = page.value(PICTURE)
        page.click(*page.value(button("Save")))
        page.wait(f"{TEXT}.includes('saved me.points.json')")
        assert page.errors == []
        assert all(url.startswith((address.rpartition("/")[0], "data:", "blob:")) for url in page.requests)
    points = read_points(saved, read_photo(portrait))
    pixel = WIDE / wide  # a drag is as exact as the page's pixels
    for name, shift in dragged.items():
        np.testing.assert_allclose(points.places[name], np.add(before[name], shift), atol=1.5 * pixel, err_msg=name)
    untouched = set(before) - set(dragged)
    assert max(np.abs(points.places[name] - before[name]).max() for name in untouched) < 1e-3
    with Page(address) as page:
        page.wait(f"window.Bokeh && Bokeh.documents.length && {POINTS_ON_PAGE}.name.length == {len(POINTS)}")
        data = page.value(POINTS_ON_PAGE)
        again = dict(zip(data["name"], zip(data["x"], data["y"], strict=True), strict=True))
        np.testing.assert_allclose(again["chin"], points.places["chin"], atol=1e-3)
        page.wait(PICTURE, 120)
        page.click(*page.wait(button("Save head")))
        page.wait(f"{TEXT}.includes('head.npz')", 120)
    written = portrait.with_name("me-head")
    assert {path.name for path in written.iterdir()} == {"head.npz", "points.json", "fit.json", "head.png"}
    fitted, kept = (read_points(path) for path in (written / "points.json", saved))
    assert fitted.places.keys() == kept.places.keys()
    np.testing.assert_allclose(fitted.places["chin"], kept.places["chin"], atol=1e-3)
    assert json.loads((written / "fit.json").read_text(encoding="utf-8"))["reprojection_rms_px"] < 0.5
