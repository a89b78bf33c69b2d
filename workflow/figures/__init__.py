# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of a run, drawn from its result folder."""
