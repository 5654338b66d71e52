"""The report's interactive 3D view, as plain data for plotly.js."""

from __future__ import annotations

import html
import json
from typing import Any

import numpy as np

from evalkit.compensation import Compensation
from evalkit.geometry import Array
from evalkit.render import colours
from evalkit.render.pivot_scene import ellipsoid_surface, pivot_as_drawn, pivot_ellipsoid, pivot_is_far
from evalkit.report.measures import View

PLAYED_FRAMES = 80
MOST_CLOUD_POINTS = 4000


def scene(view: View) -> dict[str, Any]:
    """Traces, layout and frames for ``Plotly.newPlot`` and ``Plotly.addFrames``.

    Parameters
    ----------
    view : View

    Returns
    -------
    dict
        Keys ``data``, ``layout``, ``frames``. Positions in mm in world axes, those after in the reference
        pose. Labels are escaped, because plotly.js reads them as a kind of HTML.
    """
    result = view.result
    usable = np.flatnonzero(view.ok)
    played = usable[np.unique(np.linspace(0, len(usable) - 1, min(len(usable), PLAYED_FRAMES)).astype(int))]
    before, after = view.before(played), view.after(played)
    thin = max(1, -(-before.shape[0] * before.shape[1] // MOST_CLOUD_POINTS))
    names = [html.escape(name) for name in view.labels]
    rigid, free = np.flatnonzero(view.rigid), np.flatnonzero(~view.rigid)
    all_names = names * len(played[::thin])
    data = [
        _markers(before[::thin].reshape(-1, 3), all_names, "before, all frames shown", colours.GREY, 1.5, hidden=True),
        _markers(after[::thin].reshape(-1, 3), all_names, "after, all frames shown", colours.SKY, 1.5, hidden=True),
        _markers(before[0], names, "before, this frame", colours.GREY, 3.5, "circle-open"),
        _markers(after[0][free], [names[k] for k in free], "after, this frame: face", colours.FREE, 3.5),
        _markers(after[0][rigid], [names[k] for k in rigid], "after, this frame: rigid", colours.RIGID, 4.5),
    ]
    if not len(free):
        data[3]["showlegend"] = False
    data += _pivot(result)
    frames = [
        {
            "name": str(int(frame)),
            "traces": [2, 3, 4],
            "data": [_xyz(before[k]), _xyz(after[k][free]), _xyz(after[k][rigid])],
        }
        for k, frame in enumerate(played)
    ]
    return {"data": data, "layout": _layout(view, played, data), "frames": frames}


def script_json(content: Any) -> str:
    """JSON that may stand inside a script element: no value can end the element."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _xyz(points: Array) -> dict[str, list[float | None]]:
    rounded = np.round(points, 1)
    return {name: [None if np.isnan(v) else v for v in rounded[:, k].tolist()] for k, name in enumerate("xyz")}


def _markers(
    points: Array, names: list[str], title: str, colour: str, size: float, symbol: str = "circle", hidden: bool = False
) -> dict[str, Any]:
    return {
        "type": "scatter3d", "mode": "markers", "name": title, **_xyz(points), "text": names,
        "marker": {"size": size, "color": colour, "symbol": symbol, "line": {"width": 0}},
        "hovertemplate": "%{text}<br>x %{x:.1f}, y %{y:.1f}, z %{z:.1f} mm<extra>" + title + "</extra>",
        "visible": "legendonly" if hidden else True,
    }  # fmt: skip


def _pivot(result: Compensation) -> list[dict[str, Any]]:
    """Pivot, its ellipsoid and the lines to the rigid markers."""
    towards = pivot_as_drawn(result)
    rigid = result.template[result.chosen.leading]
    lines = np.full((3 * len(rigid), 3), np.nan)
    lines[0::3], lines[1::3] = rigid, towards
    traces: list[dict[str, Any]] = [
        {
            "type": "scatter3d", "mode": "lines", "name": "lines to the pivot", **_xyz(lines),
            "line": {"color": colours.GREY, "width": 2}, "hoverinfo": "skip",
        }
    ]  # fmt: skip
    if pivot_is_far(result):
        return traces
    traces.append(_markers(result.pivot[None], ["pivot"], "pivot", colours.BLACK, 5, "diamond"))
    corners, faces = ellipsoid_surface(pivot_ellipsoid(result), result.pivot)
    traces.append(
        {
            "type": "mesh3d", "name": "pivot, 2 standard deviations", **_xyz(corners),
            "i": faces[:, 0].tolist(), "j": faces[:, 1].tolist(), "k": faces[:, 2].tolist(),
            "color": colours.PIVOT, "opacity": 0.3, "hoverinfo": "name", "showlegend": True,
        }
    )  # fmt: skip
    return traces


def _layout(view: View, played: np.ndarray, data: list[dict[str, Any]]) -> dict[str, Any]:
    shown = [np.array([trace[name] for name in "xyz"], dtype=np.float64).T for trace in data]
    points = np.concatenate(shown)
    low, high = np.nanmin(points, axis=0) - 10.0, np.nanmax(points, axis=0) + 10.0
    eye = 0.9 * view.forward - 0.85 * view.left + 0.25 * view.up
    steps = [
        {
            "label": f"{frame / view.take.rate:.2f}", "method": "animate",
            "args": [[str(int(frame))], {"mode": "immediate", "frame": {"duration": 0, "redraw": True},
                                         "transition": {"duration": 0}}],
        }
        for frame in played
    ]  # fmt: skip
    play = {
        "label": "▶ play", "method": "animate",
        "args": [None, {"fromcurrent": True, "frame": {"duration": 60, "redraw": True}, "transition": {"duration": 0}}],
    }  # fmt: skip
    stop = {
        "label": "■ stop", "method": "animate",
        "args": [[None], {"mode": "immediate", "frame": {"duration": 0, "redraw": False}}],
    }  # fmt: skip
    clear = "rgba(0,0,0,0)"
    return {
        "height": 620, "margin": {"l": 0, "r": 0, "t": 8, "b": 8}, "paper_bgcolor": clear, "font": {"size": 13},
        "modebar": {"bgcolor": clear, "color": "#999999", "activecolor": "#333333"},
        "legend": {"x": 0.005, "y": 0.99, "bgcolor": clear, "itemsizing": "constant"},
        "scene": {
            "domain": {"y": [0.12, 1]}, "aspectmode": "data", "dragmode": "orbit",
            "camera": {"eye": _vector(eye), "up": _vector(view.up), "projection": {"type": "orthographic"}},
            **{
                f"{name}axis": {
                    "title": {"text": f"{name} (mm)"}, "range": [float(low[k]), float(high[k])],
                    "backgroundcolor": "#fafafa", "gridcolor": "#dddddd", "nticks": 3, "tickfont": {"size": 11},
                }
                for k, name in enumerate("xyz")
            },
        },
        # Eighty labels under the slider could not be read; the one above it says where it stands.
        "sliders": [{
            "steps": steps, "active": 0, "x": 0.2, "len": 0.78, "y": 0, "pad": {"t": 6}, "ticklen": 0,
            "minorticklen": 0, "font": {"color": clear},
            "currentvalue": {"prefix": "time ", "suffix": " s", "font": {"color": "#1b1b1b"}},
        }],
        "updatemenus": [{
            "type": "buttons", "direction": "left", "showactive": False, "x": 0, "y": 0, "xanchor": "left",
            "yanchor": "top", "pad": {"t": 24, "l": 8}, "buttons": [play, stop],
        }],
    }  # fmt: skip


def _vector(values: Array) -> dict[str, float]:
    return dict(zip("xyz", np.round(values, 4).tolist(), strict=True))
