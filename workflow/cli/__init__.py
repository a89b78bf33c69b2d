# SPDX-License-Identifier: LGPL-3.0-or-later
"""The ``squealx`` command line."""

from workflow.cli.main import main

__all__ = ["main"]
