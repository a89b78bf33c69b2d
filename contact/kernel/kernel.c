/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* One translation unit, so that the compiler sees all; cffi puts it before its wrappers. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "kernel.h"

#include "facet.c"
#include "search.c"

#include "near.c"

#include "smooth.c"

#include "points.c"

#include "force.c"

#include "implicit.c"
