"""The editor as it is seen: the photo with its points, a checklist, and the fitted head beside them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.editor.editing import Editing
from evalkit.editor.preview import SIZE, Preview
from evalkit.errors import EvalkitError
from evalkit.head.model import Head
from evalkit.head.photo import Photo, read_photo
from evalkit.head.points import POINTS, REQUIRED, Points, read_points
from evalkit.render.colours import GREEN, SKY, VERMILION

WIDTH, HEIGHT = 760, 800
"""Of the photo on the page, pixels."""

SHOWN_PIXELS = 1200
"""Longest side of the photo as it is sent to the page."""

HELP = """**Drag** a point to where it belongs; the wheel zooms, pan and reset are beside the photo. *Left* and *right*
are the person's. A **click** on the photo places the next point; *Delete* takes the chosen one away."""


PATIENT_PRESS = """
const gestures = Bokeh.index.get_one(plot).canvas?.ui_event_bus?.ui_gestures
if (gestures != null) { gestures.constructor.press_threshold = 1e9 }"""
"""Bokeh takes a button that is held still for 0.3 s, by a careful hand or on a busy machine, for no drag any more."""


ASKED = {
    "pupil right": "the middle of the person's right eye, on the left",
    "pupil left": "the middle of the person's left eye, on the right",
}
"""What to click first, in words; a whole face to drag follows from the eyes."""


def edit(photo: str | Path, points: str | Path | None = None, head: Head | None = None) -> Any:
    """The editor for a notebook cell: ``edit("me.jpg")`` as the last line shows it.

    Parameters
    ----------
    photo : str or Path
    points : str or Path, optional
        File to start from and to save to; by default the photo's name with the ending ``.points.json``.
    head : Head, optional
        To fit; by default the built-in one.

    Returns
    -------
    panel.viewable.Viewable
        Its ``.editor`` is the :class:`Editor`: ``.editor.editing.places``, ``.editor.preview.head``.

    Raises
    ------
    EvalkitError
        If a file cannot be read, or the extra ``editor`` is not installed.
    """
    require_panel()
    import panel

    panel.extension()
    made = Editor.open(Path(photo), None if points is None else Path(points), head)
    return made.view()


def require_panel() -> None:
    """Refuse in one line where the editor's packages are missing.

    Raises
    ------
    EvalkitError
        If Panel is not installed.
    """
    try:
        import panel  # noqa: F401
    except ImportError as error:
        raise EvalkitError("the editor needs Panel and Bokeh: pip install 'evalkit[editor]'") from error


def points_file(photo: Path) -> Path:
    """Where the points of a photo are kept if nothing else is said: beside it."""
    return photo.with_suffix(".points.json")


class Editor:
    """One photo's editor; one page shows it.

    Parameters
    ----------
    editing : Editing
    preview : Preview
    path : Path
        Where the points are saved.
    keep : callable, optional
        ``keep(head, report, points) -> str`` keeps the fitted head and says where; without it there is no button.
    """

    def __init__(
        self, editing: Editing, preview: Preview, path: Path, keep: Callable[[Any, Any, Points], str] | None = None
    ) -> None:
        self.editing, self.preview, self.path, self.keep = editing, preview, path, keep
        # OpenGL belongs to the thread that made its window, and a page must answer while a head is fitted.
        self._artist = ThreadPoolExecutor(1, thread_name_prefix="preview")
        self._stale = True
        self._busy = False
        self._from_page = False
        self._closed = False

    @classmethod
    def open(cls, photo: Path, points: Path | None = None, head: Head | None = None, **more: Any) -> Editor:
        """The editor of a photo's file, with the points that are kept for it, or those of the detector if there is one.

        Raises
        ------
        EvalkitError
            If a file cannot be read.
        """
        from evalkit.head import load_head

        picture = read_photo(photo)
        path = points or points_file(photo)
        start = read_points(path, picture) if path.exists() else _proposed(picture)
        return cls(Editing(picture, start), Preview(picture, head or load_head()), path, **more)

    def view(self) -> Any:
        """The page."""
        import panel as pn

        self._build()
        buttons = [self.undo, self.redo, self.detect, self.load, self.save]
        view = pn.Row(
            pn.Column(pn.pane.Markdown(HELP, width=WIDTH), pn.pane.Bokeh(self.figure), width=WIDTH + 40),
            pn.Column(
                pn.Row(*buttons),
                pn.Row(self.mirror, self.names),
                self.list,
                self.message,
                self.picture,
                self.turn,
                self.mouth,
                *([self.store] if self.keep else []),
                width=SIZE + 60,
            ),
        )
        view.editor = self
        pn.state.onload(self._refresh)
        return view

    def _build(self) -> None:
        import panel as pn

        self.names = pn.widgets.Checkbox(name="Names", value=False)
        self.source, self.figure = self._photo_with_points()
        self.undo = pn.widgets.Button(name="Undo", width=70)
        self.redo = pn.widgets.Button(name="Redo", width=70)
        self.detect = pn.widgets.Button(
            name="Detect", width=75, description="Points of the face detector, if there is one"
        )
        self.load = pn.widgets.Button(name="Load", width=70, description=f"Points from {self.path.name}")
        self.save = pn.widgets.Button(name="Save", width=70, button_type="primary", description=f"To {self.path.name}")
        self.store = pn.widgets.Button(name="Save head", button_type="success", width=SIZE)
        self.mirror = pn.widgets.Checkbox(name="Move both sides", value=self.editing.symmetric)
        self.list = pn.widgets.Select(name="Next point", options=[], size=6, width=SIZE)
        # Of one height: what moves on the page while a point is dragged would make the drag end.
        self.message = pn.pane.Alert(
            "", alert_type="light", width=SIZE, height=150, sizing_mode="fixed", styles={"overflow-y": "auto"}
        )
        self.picture = pn.pane.PNG(None, width=SIZE, height=SIZE, sizing_mode="fixed")
        self.turn = pn.widgets.FloatSlider(name="Turn, deg", start=-30, end=30, step=2, value=0, width=SIZE)
        self.mouth = pn.widgets.FloatSlider(name="Mouth open", start=0, end=1, step=0.05, value=0, width=SIZE)
        self.undo.on_click(lambda _: self._after(self.editing.undo()))
        self.redo.on_click(lambda _: self._after(self.editing.redo()))
        self.detect.on_click(lambda _: self._try(self._detect, "points of the detector"))
        self.load.on_click(lambda _: self._try(lambda: self.editing.load(self.path), f"loaded {self.path.name}"))
        self.save.on_click(lambda _: self._try(lambda: self.editing.save(self.path), f"saved {self.path.name}"))
        self.store.on_click(lambda _: self._try(self._keep))
        self.mirror.param.watch(lambda event: setattr(self.editing, "symmetric", event.new), "value")
        for slider in (self.turn, self.mouth):
            slider.param.watch(lambda _: pn.state.execute(self._show), "value")

    def _photo_with_points(self) -> tuple[Any, Any]:
        from bokeh.models import ColumnDataSource, CustomJS, HoverTool, LabelSet, PointDrawTool, Range1d
        from bokeh.plotting import figure

        wide, high = self.editing.photo.size
        pixels = self.editing.photo.pixels
        step = max(1, -(-max(pixels.shape) // SHOWN_PIXELS))
        shown = np.ascontiguousarray(pixels[::step, ::step])
        # Bokeh takes a picture as 32-bit numbers, lowest row first.
        packed = np.dstack([shown, np.full(shown.shape[:2], 255, np.uint8)]).view(np.uint32)[..., 0]
        scale = min(WIDTH / wide, HEIGHT / high)
        plot = figure(
            frame_width=round(wide * scale), frame_height=round(high * scale), x_range=Range1d(0, wide),
            y_range=Range1d(high, 0), tools="wheel_zoom,pan,reset", active_scroll="wheel_zoom", active_drag=None,
            toolbar_location="right",
        )  # fmt: skip
        plot.axis.visible = False
        plot.grid.visible = False
        plot.image_rgba(image=[packed], x=0, y=0, dw=wide, dh=high)
        source = ColumnDataSource(self._columns())
        # Rings, so that the photo is seen in them, and wide: a drag counts as begun some pixels from where the mouse
        # was pressed, and what is not hit there is not taken along.
        drawn = plot.scatter(
            "x", "y", source=source, size=17, fill_color="colour", fill_alpha=0.25, line_color="colour", line_width=2,
            nonselection_fill_alpha=0.25, nonselection_line_alpha=0.9,
        )  # fmt: skip
        names = LabelSet(
            x="x", y="y", text="name", source=source, x_offset=8, y_offset=4, text_font_size="9px", text_color="white",
            background_fill_color="black", background_fill_alpha=0.45, visible=False,
        )  # fmt: skip
        plot.add_layout(names)
        self.names.jslink(names, value="visible")
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=[("", "@name")]))
        drag = PointDrawTool(renderers=[drawn], add=True, empty_value="")
        plot.add_tools(drag)
        plot.toolbar.active_tap = drag
        plot.toolbar.active_drag = drag
        plot.js_on_event("mouseenter", CustomJS(args={"plot": plot}, code=PATIENT_PRESS))
        source.on_change("data", self._edited)
        return source, plot

    def _columns(self) -> dict[str, list[Any]]:
        names = [name for name in POINTS if name in self.editing.places]
        places = [self.editing.places[name] for name in names]
        colours = [SKY if name.endswith("left") else VERMILION if name.endswith("right") else GREEN for name in names]
        return {
            "x": [float(p[0]) for p in places], "y": [float(p[1]) for p in places], "name": names, "colour": colours,
        }  # fmt: skip

    def _edited(self, _attribute: str, _old: Any, new: Any) -> None:
        """The page has sent points: find out what was done, and do it to the points that count."""
        if self._from_page:
            return
        self._try(lambda: self._take(dict(new)))

    def _take(self, new: dict[str, Any]) -> None:
        names = [str(name) for name in new["name"]]
        for name in set(self.editing.places) - set(names):
            self.editing.remove(name)
        for name, x, y in zip(names, new["x"], new["y"], strict=True):
            if not name and self.editing.missing:
                # Before there is a face, the eyes are asked for, whatever is chosen in the list.
                asked = self.editing.next
                chosen = self.list.value if asked == self.editing.missing[0] else asked
                self.editing.put((x, y), chosen or asked)
            elif name and not np.allclose(self.editing.places[name], (x, y), atol=1e-6):
                self.editing.move(name, (x, y))

    def _detect(self) -> None:
        from evalkit.head.points import propose_points

        self.editing.replace(propose_points(self.editing.photo))

    def _keep(self) -> str:
        if self.preview.head is None or self.keep is None:
            raise EvalkitError("nothing is fitted yet")
        return self.keep(self.preview.head, self.preview.report, self.editing.points())

    def _try(self, action: Callable[[], Any], done: str = "") -> None:
        try:
            text = action()
        except EvalkitError as error:
            self._say(str(error), "danger")
            self._after(True, quiet=True)
        else:
            self._after(True, quiet=bool(text or done))
            if text or done:
                self._say(text if isinstance(text, str) else done, "success")

    def _after(self, _changed: bool, quiet: bool = False) -> None:
        """Show what the points are now, and fit the head to them."""
        import panel as pn

        self._stale = True
        self._draw_points()
        pn.state.execute(partial(self._refresh, quiet))

    def _draw_points(self) -> None:
        """The points on the photo; only while an event of the page is handled, when its document may be changed."""
        columns = self._columns()
        if {name: list(values) for name, values in self.source.data.items()} == columns:
            # Sending back what the page has just sent would pull a point out of a hand that is at the next one.
            return
        self._from_page = True
        try:
            self.source.data = columns
        finally:
            self._from_page = False

    def _draw_list(self) -> None:
        missing = self.editing.missing
        self.list.options = missing
        self.list.value = self.editing.next
        required = sum(name in REQUIRED for name in missing)
        self.list.name = (
            f"Next point ({len(missing)} not placed, {required} of them needed)" if missing else "All points are placed"
        )
        self.undo.disabled, self.redo.disabled = not self.editing.can_undo, not self.editing.can_redo

    async def _refresh(self, quiet: bool = False) -> None:
        """Fit the head if the points have changed, and show it; changes that come meanwhile are taken up after."""
        import asyncio

        self._draw_list()
        if self._busy:
            return
        self._busy = True
        try:
            while self._stale and not self._closed:
                self._stale = False
                if any(name in REQUIRED for name in self.editing.missing):
                    self._say(f"Click {ASKED.get(self.editing.next or '', self.editing.next)} in the photo.", "info")
                    continue
                points = self.editing.points()
                try:
                    report = await asyncio.get_running_loop().run_in_executor(self._artist, self.preview.fit, points)
                except EvalkitError as error:
                    self._say(str(error), "danger")
                    continue
                if not quiet:
                    self._say("  \n".join(report.lines()), "light")
                await self._show()
        finally:
            self._busy = False

    async def _show(self) -> None:
        import asyncio

        # A page may be left while its head is fitted.
        if self.preview.head is None or self._closed:
            return
        run = asyncio.get_running_loop().run_in_executor
        self.picture.object = await run(self._artist, self.preview.picture, self.turn.value, self.mouth.value)

    def _say(self, text: str, kind: str) -> None:
        self.message.alert_type = kind
        self.message.object = text

    def close(self) -> None:
        """Give back the window behind the preview."""
        self._closed = True
        self._artist.submit(self.preview.close)
        self._artist.shutdown()


def _proposed(photo: Photo) -> Points | None:
    """Points of the detector; None where there is none or it finds no face: the eyes are clicked then."""
    from evalkit.head.points import propose_points

    try:
        return propose_points(photo)
    except EvalkitError:
        return None
