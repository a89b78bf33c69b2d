# SPDX-License-Identifier: LGPL-3.0-or-later
"""``python -m workflow.cli``: the ``squealx`` command without an installed script."""

from workflow.cli.main import main

main()
