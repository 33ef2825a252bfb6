"""The application: the page's files, the questions at ``/api``, and what is said when one cannot be answered."""

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
from trackprofile.server.endpoints import UnchangedError, endpoints
from trackprofile.server.line_catalogue import Catalogue, UnknownError
from trackprofile.server.security import (
    LARGEST_BODY,
    SecurityMiddleware,
    SecuritySettings,
    may_read,
)
from trackprofile.server.session import COOKIE, LASTS, new_session, session_is_valid
from trackprofile.server.static_files import page_files
from trackprofile.store import Store

THREADS = 6
"""Questions that are worked on at once; the others wait, and memory stays within bounds."""


class Login(BaseModel):
    """What is sent to log in."""

    model_config = ConfigDict(extra="forbid")

    token: str = Field(min_length=1, max_length=LARGEST_BODY)


def page_app(store: Store, rules: SecuritySettings) -> ASGIApp:
    """The page over a store, and its figures as JSON, behind the gate.

    Parameters
    ----------
    store : that is read; nothing here writes
    rules : of the gate

    Examples
    --------
    >>> from trackprofile.store import create
    >>> gate = page_app(create("memory://example-of-page-app"), Rules())
    >>> sorted(gate.inner.openapi()["paths"])[0]
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
    app.include_router(endpoints(Catalogue(store), locked=rules.token is not None))
    _add_files(app)
    _add_login(app, rules.token)
    _add_errors(app)
    return SecurityMiddleware(app, rules)


@asynccontextmanager
async def _lifespan(_: FastAPI) -> AsyncIterator[None]:
    anyio.to_thread.current_default_thread_limiter().total_tokens = THREADS
    yield


def _add_files(app: FastAPI) -> None:
    known = page_files()

    def sent(name: str, request: Request) -> Response:
        file = known.get(name)
        if file is None:
            raise HTTPException(404)
        headers = {"etag": file.tag, "cache-control": "no-cache"}
        if file.tag in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        return Response(file.content, media_type=file.media_type, headers=headers)

    @app.get("/", include_in_schema=False)
    async def page(request: Request) -> Response:
        return sent("index.html", request)

    @app.get("/static/{name}", include_in_schema=False)
    async def static(name: str, request: Request) -> Response:
        return sent(name, request)


def _add_login(app: FastAPI, token: str | None) -> None:
    @app.get("/session", include_in_schema=False)
    async def session(request: Request) -> Response:
        return JSONResponse({"open": may_read(request.headers, token)})

    @app.post("/login", include_in_schema=False)
    async def login(said: Login, request: Request) -> Response:
        if token is None or not session_is_valid(token, said.token):
            return _problem(401, "That is not the token.")
        response = JSONResponse({})
        response.set_cookie(
            COOKIE, new_session(token), max_age=LASTS, httponly=True, samesite="strict",
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
        return _problem(404, str(error))

    @app.exception_handler(DataError)
    async def unusable(_: Request, error: Exception) -> Response:
        return _problem(422, str(error))

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return _problem(422, _in_words(error))

    @app.exception_handler(HTTPException)
    async def refused(_: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        words = {404: "There is nothing at this address.", 405: "This server is only read from."}
        sentence = words.get(error.status_code, str(error.detail))
        return _problem(error.status_code, sentence, dict(error.headers or {}))

    @app.exception_handler(UnchangedError)
    async def unchanged(_: Request, error: Exception) -> Response:
        assert isinstance(error, UnchangedError)
        headers = {"etag": error.tag, "cache-control": "private, no-cache"}
        return Response(status_code=304, headers=headers)

    @app.exception_handler(FileError)
    async def damaged(_: Request, error: Exception) -> Response:
        print(f"trackprofile: {error}", file=sys.stderr)  # noqa: T201
        return _problem(
            500, "The store cannot be read here; see what trackprofile store verify says."
        )


def _in_words(error: RequestValidationError) -> str:
    """The first thing that is wrong with a question, without what was asked: it may be of any length."""
    first = error.errors()[0]
    place = ".".join(str(one) for one in first["loc"][1:])[:60] or "the question"
    return f"{place}: {first['msg'][:200]}."


def _problem(status: int, sentence: str, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse({"error": " ".join(sentence.split())}, status, headers)
