"""The ASGI application: static scene and page by HTTP, live clients by WebSocket."""

from collections.abc import Mapping

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from mixpinn.server.client_link import ClientLink
from mixpinn.server.gate import App, Door, Gate
from mixpinn.server.page_files import page_files
from mixpinn.server.service import Service


def make_app(service: Service, door: Door, *, page: Mapping[str, tuple[str, bytes]] | None = None) -> App:
    """The application.

    Args:
        service: what clients share.
        door: whom to let in.
        page: content type and bytes by path; by default the installed page.
    """
    files = {**(page_files() if page is None else page), **service.scene.files}

    async def file(request: Request) -> Response:
        found = files.get(request.url.path)
        if found is None:
            return PlainTextResponse("there is nothing here\n", 404)
        return Response(found[1], media_type=found[0], headers={"cache-control": "no-cache"})

    async def download(request: Request) -> Response:
        found = service.download(request.path_params["key"], request.path_params["name"])
        if found is None or not found.path.is_file():
            return PlainTextResponse("there is nothing here\n", 404)
        return FileResponse(found.path, filename=found.name, media_type="application/octet-stream")

    async def live(websocket: WebSocket) -> None:
        await ClientLink(websocket, service).run()

    routes = [
        Route("/download/{key}/{name}", download, methods=["GET"]), WebSocketRoute("/live", live),
        Route("/{path:path}", file, methods=["GET"]),
    ]
    return Gate(Starlette(routes=routes), door)
