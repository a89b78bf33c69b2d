# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simulation of a model: rest, start, central difference, guards, checkpoints."""
