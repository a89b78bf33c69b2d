# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies with closed-form answers: bars, blocks, caps, cylinders and rollers."""
