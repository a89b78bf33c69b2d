# SPDX-License-Identifier: LGPL-3.0-or-later
"""Natural modes of a wheel or body of a scene."""
