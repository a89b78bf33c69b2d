# SPDX-License-Identifier: LGPL-3.0-or-later
"""Result folder of a run: written as it goes, read back as arrays."""
