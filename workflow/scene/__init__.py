# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene as a checked set of tables: read, changed and written."""

from workflow.scene.scene import Scene, SceneError, names

__all__ = ["Scene", "SceneError", "names"]
