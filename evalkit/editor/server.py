"""The editor as a page on this machine alone: loopback, a random token in the address, no other origin."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from evalkit.editor.page import Editor, require_panel
from evalkit.errors import EvalkitError
from evalkit.head.model import Head

ADDRESS = "127.0.0.1"

ROUTE = "edit"


def serve(
    photo: Path,
    points: Path | None = None,
    head: Head | None = None,
    output: Path | None = None,
    port: int = 0,
    show: bool = True,
    tell: Any = print,
) -> None:
    """Serve the editor of a photo until the process is interrupted.

    Parameters
    ----------
    photo : Path
    points : Path, optional
        As in :func:`evalkit.editor.page.edit`.
    head : Head, optional
    output : Path, optional
        Folder that the fitted head is kept in.
    port : int
        0 takes a free one.
    show : bool
        Open a browser.
    tell : callable
        Gets the address.

    Raises
    ------
    EvalkitError
        If a file cannot be read, the port is taken, or the extra ``editor`` is not installed.
    """
    server, address = make_server(photo, points, head, output, port)
    tell(address)
    if show:
        import webbrowser

        webbrowser.open(address)
    server.run_until_shutdown()


def make_server(
    photo: Path, points: Path | None = None, head: Head | None = None, output: Path | None = None, port: int = 0
) -> tuple[Any, str]:
    """A server that is not started yet, and the address of its page; see :func:`serve`."""
    require_panel()
    from panel.io.server import get_server

    from evalkit.head import load_head

    # Read once before anything is served: a mistake is said in the shell and not on an empty page.
    generic = head or load_head()
    Editor.open(photo, points, generic).close()

    def page() -> Any:
        import panel

        editor = Editor.open(photo, points, generic, keep=_keeper(photo, output))
        panel.state.on_session_destroyed(lambda _: editor.close())
        return editor.view()

    token = secrets.token_urlsafe(24)
    port = port or _free_port()
    try:
        server = get_server(
            {ROUTE: page}, port=port, address=ADDRESS, prefix=f"/{token}", show=False, start=False,
            title=f"{photo.name} - evalkit", auth_provider=_guard(), include_headers=[], include_cookies=[],
            websocket_origin=f"{ADDRESS}:{port}",
        )  # fmt: skip
    except OSError as error:
        raise EvalkitError(
            f"port {port}: cannot be served on ({error.strerror or error}); choose another --port"
        ) from error
    return server, f"http://{ADDRESS}:{server.port}/{token}/{ROUTE}"


def _free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind((ADDRESS, 0))
        return int(probe.getsockname()[1])


def _keeper(photo: Path, output: Path | None) -> Any:
    if output is None:
        return None

    def keep(head: Any, report: Any, points: Any) -> str:
        from evalkit.head.photo import read_photo
        from evalkit.render.fitted import write_fitted

        written = write_fitted(head, report, points, read_photo(photo), output)
        return f"saved {', '.join(str(path) for path in written)}"

    return keep


def _guard() -> Any:
    """Refuses what another page sends: its Origin is not this server's, or its Host is a name made to point here."""
    from bokeh.server.auth_provider import AuthProvider
    from tornado.web import HTTPError, RequestHandler

    def user(handler: RequestHandler) -> str:
        host = handler.request.host
        origin = handler.request.headers.get("Origin")
        if host.rpartition(":")[0] != ADDRESS or (origin and urlsplit(origin).netloc != host):
            raise HTTPError(403, "another origin")
        return "editor"

    class SameOrigin(AuthProvider):  # type: ignore[misc]
        endpoints = property(lambda self: [])
        get_user = property(lambda self: user)
        get_user_async = property(lambda self: None)
        login_url = property(lambda self: None)
        get_login_url = property(lambda self: lambda handler: "/")
        login_handler = property(lambda self: None)
        logout_url = property(lambda self: None)
        logout_handler = property(lambda self: None)

    return SameOrigin()
