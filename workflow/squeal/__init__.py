# SPDX-License-Identifier: LGPL-3.0-or-later
"""Squeal: complex eigenvalues of a sliding state."""
