"""The ASGI application: files of the web viewer, endpoints at ``/api``, login, and the answers to errors."""

from __future__ import annotations

import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio.to_thread
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp

from trackprofile import __version__
from trackprofile.errors import DataError, FileError
from trackprofile.server.endpoints import NotModifiedError, endpoints
from trackprofile.server.line_catalogue import LineCatalogue, UnknownError
from trackprofile.server.security import (
    MAX_BODY_BYTES,
    SecurityMiddleware,
    SecuritySettings,
    may_read,
)
from trackprofile.server.session import COOKIE, SESSION_SECONDS, new_session, token_matches
from trackprofile.server.static_files import static_files
from trackprofile.store import Store

THREADS = 6
"""Number of requests that are worked on at once; others wait, so that memory is bounded."""


class Login(BaseModel):
    """Body of a login request."""

    model_config = ConfigDict(extra="forbid")

    token: str = Field(min_length=1, max_length=MAX_BODY_BYTES)


def viewer_app(store: Store, settings: SecuritySettings) -> ASGIApp:
    """The web viewer of a store and its data as JSON, behind the security checks.

    Parameters
    ----------
    store : store to read; the application writes nothing
    settings : of the security checks

    Examples
    --------
    >>> from trackprofile.store import create
    >>> app = viewer_app(create("memory://example-of-viewer-app"), SecuritySettings())
    >>> sorted(app.inner.openapi()["paths"])[0]
    '/api/compare'
    """
    app = FastAPI(
        title="trackprofile",
        version=__version__,
        description="Track profiles with their uncertainty, from a store. Read-only.",
        docs_url=None,
        redoc_url=None,
        openapi_url="/openapi.json",
        lifespan=_lifespan,
    )
    app.add_middleware(GZipMiddleware, minimum_size=1000, compresslevel=4)
    app.include_router(endpoints(LineCatalogue(store), token_required=settings.token is not None))
    _add_files(app)
    _add_login(app, settings.token)
    _add_errors(app)
    return SecurityMiddleware(app, settings)


@asynccontextmanager
async def _lifespan(_: FastAPI) -> AsyncIterator[None]:
    anyio.to_thread.current_default_thread_limiter().total_tokens = THREADS
    yield


def _add_files(app: FastAPI) -> None:
    known = static_files()

    def answer(name: str, request: Request) -> Response:
        file = known.get(name)
        if file is None:
            raise HTTPException(404)
        headers = {"etag": file.tag, "cache-control": "no-cache"}
        if file.tag in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        return Response(file.content, media_type=file.media_type, headers=headers)

    @app.get("/", include_in_schema=False)
    async def viewer(request: Request) -> Response:
        return answer("index.html", request)

    @app.get("/static/{name:path}", include_in_schema=False)
    async def static(name: str, request: Request) -> Response:
        return answer(name, request)


def _add_login(app: FastAPI, token: str | None) -> None:
    @app.get("/session", include_in_schema=False)
    async def session(request: Request) -> Response:
        return JSONResponse({"open": may_read(request.headers, token)})

    @app.post("/login", include_in_schema=False)
    async def login(body: Login, request: Request) -> Response:
        if token is None or not token_matches(token, body.token):
            return _error(401, "The token is wrong.")
        response = JSONResponse({})
        response.set_cookie(
            COOKIE, new_session(token), max_age=SESSION_SECONDS, httponly=True, samesite="strict",
            secure=request.url.scheme == "https",
        )  # fmt: skip
        return response

    @app.post("/logout", include_in_schema=False)
    async def logout() -> Response:
        response = JSONResponse({})
        response.delete_cookie(COOKIE, httponly=True, samesite="strict")
        return response


def _add_errors(app: FastAPI) -> None:
    @app.exception_handler(UnknownError)
    async def unknown(_: Request, error: Exception) -> Response:
        return _error(404, str(error))

    @app.exception_handler(DataError)
    async def unusable(_: Request, error: Exception) -> Response:
        return _error(422, str(error))

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return _error(422, _first_error(error))

    @app.exception_handler(HTTPException)
    async def refused(_: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        sentences = {404: "This address does not exist.", 405: "This server is read-only."}
        sentence = sentences.get(error.status_code, str(error.detail))
        return _error(error.status_code, sentence, dict(error.headers or {}))

    @app.exception_handler(NotModifiedError)
    async def not_modified(_: Request, error: Exception) -> Response:
        assert isinstance(error, NotModifiedError)
        headers = {"etag": error.tag, "cache-control": "private, no-cache"}
        return Response(status_code=304, headers=headers)

    @app.exception_handler(FileError)
    async def damaged(_: Request, error: Exception) -> Response:
        print(f"trackprofile: {error}", file=sys.stderr)  # noqa: T201
        return _error(500, "The store cannot be read; run: trackprofile store verify.")


def _first_error(error: RequestValidationError) -> str:
    """The first error of a request, without the value, which may be of any length."""
    first = error.errors()[0]
    parameter = ".".join(str(one) for one in first["loc"][1:])[:60] or "the request"
    return f"{parameter}: {first['msg'][:200]}."


def _error(status: int, sentence: str, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse({"error": " ".join(sentence.split())}, status, headers)
