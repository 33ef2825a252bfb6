"""Web viewer of a store, and the same data as JSON for other programs; read-only, without any other server.

`app.viewer_app` builds the ASGI application, `serve.serve` runs it. The package needs the extra ``network``.
"""
