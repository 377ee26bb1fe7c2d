"""Web server of a page: it runs on a thread of its own and serves this machine's browser."""
