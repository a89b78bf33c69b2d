# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies: many runs side by side, and their comparison."""
