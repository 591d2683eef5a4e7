"""Helpers shared by several test modules: scenes, random shapes, folders of the repository, a browser. No tests."""
