# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report of a run as one HTML page."""
