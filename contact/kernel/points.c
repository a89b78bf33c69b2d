/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Points in the facets of the contactor. They move with the nodes of the facet and load them by its
 * shape functions, so that forces, moments and work are those of a force at the point. */

void wr_place(const wr_points *points, int64_t k, const int32_t *item, double *xv) {
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    double sum[6] = {0, 0, 0, 0, 0, 0};
    for (size_t b = 4 * c; b < 4 * (c + 1); b++) {
      const double *x = xv + 6 * (size_t)points->node[b];
      for (int a = 0; a < 6; a++)
        sum[a] += points->weight[b] * x[a];
    }
    memcpy(xv + 6 * c, sum, sizeof sum);
  }
}

void wr_raise(const wr_points *points, const wr_candidates *near, wr_state *state) {
  for (int64_t i = 0; i < near->k; i++) {
    const size_t c = (size_t)near->item[i];
    state->gap[c] -= points->height[c];
  }
}

/* Adds the velocity of a point that its nodes have in dv. */
static inline void carried(const wr_points *points, size_t c, const double *dv, double *w) {
  for (size_t b = 4 * c; b < 4 * (c + 1); b++)
    for (size_t a = 0; a < 3; a++)
      w[a] += points->weight[b] * dv[3 * (size_t)points->node[b] + a];
}

/* Adds the velocities that an impulse at a point gives to its nodes. */
static inline void spread(const wr_points *points, size_t c, const double *impulse, double *dv) {
  for (size_t b = 4 * c; b < 4 * (c + 1); b++)
    for (size_t a = 0; a < 3; a++)
      dv[3 * (size_t)points->node[b] + a] += points->per_mass[b] * impulse[a];
}

/* Inverse mass that a force at a point meets; its nodes get no velocity yet. */
static double point_mass(const wr_points *points, size_t c, double *dv) {
  double sum = 0.0;
  for (size_t b = 4 * c; b < 4 * (c + 1); b++) {
    sum += points->weight[b] * points->per_mass[b];
    memset(dv + 3 * (size_t)points->node[b], 0, 3 * sizeof *dv);
  }
  return sum;
}
