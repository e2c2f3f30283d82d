"""The build that colcon takes, as setup.cfg says; pip takes the one of pyproject.toml."""

from setuptools import setup

setup()
