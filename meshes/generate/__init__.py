# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hexahedra from plane sections: blocks, sweeps, 3:1 refinement, smoothing."""
