"""The exception of this package."""


class Error(Exception):
    """A file, a session or a library cannot be used. The text names the path and says what to do."""
