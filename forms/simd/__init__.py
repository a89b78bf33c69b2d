# SPDX-License-Identifier: LGPL-3.0-or-later
"""FFCx language backend that evaluates a cell kernel on several cells at once.

FFCx loads it by name, ``options["language"] = "forms.simd"``. Scalars of FFCx's C become GCC/Clang
vector-extension types with one lane per cell; tables, weights and constants stay scalar. Around
each kernel stands a loop over batches of cells that gathers and scatters by dof index.
"""

from ffcx.codegeneration.C import expression, form

from forms.simd import file, integral
from forms.simd.formatter import Formatter

__all__ = ["Formatter", "expression", "file", "form", "integral"]
