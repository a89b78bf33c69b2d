# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stability matrix: small runs at the edge of what a scene can ask for, each with a verdict."""
