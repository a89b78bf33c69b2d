# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh files of other programs: reading, checking and writing hexahedra with named groups."""
