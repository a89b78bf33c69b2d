# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tables of a scene: read, checked, changed and written."""

from workflow.scene.scene import Scene, SceneError, names

__all__ = ["Scene", "SceneError", "names"]
