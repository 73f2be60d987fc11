"""The version of this package, which a release's other files repeat (`tests/test_release.py`)."""

__version__ = "0.2.0"
