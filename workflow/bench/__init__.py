# SPDX-License-Identifier: LGPL-3.0-or-later
"""Benchmark of a machine: cell kernels, roofline, whole steps, contact, other codes, main scene."""
