# SPDX-License-Identifier: LGPL-3.0-or-later
"""Audit of a scene before its run: stable step, penalty, damping, mesh quality, advice."""
