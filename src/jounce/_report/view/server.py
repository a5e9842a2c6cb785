"""The server of the live view: for browsers on this machine, for no page but its own, and without a word printed."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from threading import Lock
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from jounce.core.errors import JounceError

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"  # other machines see nothing
NAMES_OF_HOST = (HOST, "localhost")  # in addresses of browsers here, and at the near end of a tunnel
FIRST_PORT = 8080  # the first that is tried
_REPLACING = Lock()  # of attributes of modules, which are restored in reverse order


@contextmanager
def serve(port: int | None) -> Iterator["viser.ViserServer"]:
    """Serve an empty page in this context, on a given port, if it is free, or the first free one from `FIRST_PORT`."""
    import viser

    first = FIRST_PORT if port is None else _free_port(port)
    with _REPLACING, _refuse_foreign_pages(), _silence_rich():
        server = viser.ViserServer(host=HOST, port=first, label="jounce", verbose=False)
    try:
        yield server
    finally:
        with _REPLACING, _silence_rich():
            server.stop()


def refusal(headers: Any) -> str | None:
    """Return why a request is refused: its page is not served here, or a name of another host leads here.

    A browser lets the page of any site connect to a WebSocket of this machine; it states the origin of the page.
    Requests without an origin come from programs, which may state what they like.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    if urlsplit(f"//{host}").hostname not in NAMES_OF_HOST:
        return f"this server is reached as {' or '.join(NAMES_OF_HOST)}\n"
    if origin is not None and origin != f"http://{host}":
        return "pages of other origins are refused\n"
    return None


@contextmanager
def _refuse_foreign_pages() -> Iterator[None]:
    """Inside, WebSocket servers refuse what `refusal` does; viser has no option for it."""
    server: Any = import_module("websockets.asyncio.server")
    original = server.serve

    def guarded(*arguments: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            found = refusal(request.headers)
            return process_request(connection, request) if found is None else connection.respond(403, found)

        return original(*arguments, process_request=process, **options)

    server.serve = guarded
    try:
        yield
    finally:
        server.serve = original


@contextmanager
def _silence_rich() -> Iterator[None]:
    """Inside, rich prints nothing, by which viser prints an address of its own; stdout stays as it is."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _free_port(port: int) -> int:
    """A port that is free, any for 0."""
    with socket.socket() as trial:
        try:
            trial.bind((HOST, port))
        except OSError as error:
            raise JounceError(f"port {port} cannot be used: {error.strerror}; choose another by --port") from None
        return int(trial.getsockname()[1])
