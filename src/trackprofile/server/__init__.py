"""The page over a store, and the same figures as JSON for other programs: read-only, from this server alone.

`app.page_app` makes the application (ASGI), `listen.serve` runs it. It needs the extra ``network``.
"""
