# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheelset, rail and sleepers as hexahedra in the track."""
