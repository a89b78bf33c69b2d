/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Positions, bucket grid, candidates, tracking. */
double wr_gather(int64_t k, const int32_t *item, const int32_t *dof, const double *X,
                 const double *u, const double *v, const double *past, double *xv) {
  double far = 0.0;
  for (int64_t i = 0; i < k; i++) {
    const size_t j = (size_t)item[i];
    if (dof[j] < 0)
      continue;
    const double *w = u + 3 * (size_t)dof[j];
    double *x = xv + 6 * j;
    double moved = 0.0;
    for (int a = 0; a < 3; a++) {
      x[a] = X[3 * j + a] + w[a];
      moved += (x[a] - past[3 * j + a]) * (x[a] - past[3 * j + a]);
    }
    memcpy(x + 3, v + 3 * (size_t)dof[j], 3 * sizeof(double));
    if (moved > far || isnan(moved))
      far = moved; /* NaN gets through */
  }
  return sqrt(far);
}

static inline int64_t slot(double x, double origin, double edge, int64_t cells) {
  const double s = floor((x - origin) / edge);
  return s > 0.0 ? (s < (double)(cells - 1) ? (int64_t)s : cells - 1) : 0;
}

int64_t wr_buckets(int64_t m, const wr_grid *grid, int64_t *cursor, int32_t *entry) {
  const int64_t *dims = grid->dims;
  int64_t count = 0, low[3], high[3];
  for (int64_t i = 0; i < m; i++) {
    const double *box = grid->box + 6 * i;
    for (int a = 0; a < 3; a++) {
      low[a] = slot(box[a], grid->origin[a], grid->edge, dims[a]);
      high[a] = slot(box[3 + a], grid->origin[a], grid->edge, dims[a]);
    }
    for (int64_t x = low[0]; x <= high[0]; x++)
      for (int64_t y = low[1]; y <= high[1]; y++)
        for (int64_t z = low[2]; z <= high[2]; z++) {
          int64_t *c = cursor + (x * dims[1] + y) * dims[2] + z;
          if (entry)
            entry[*c] = (int32_t)i;
          *c += 1;
          count++;
        }
  }
  return count;
}

static inline int inside(const double *box, const double *p) {
  return p[0] >= box[0] && p[1] >= box[1] && p[2] >= box[2] && p[0] <= box[3] && p[1] <= box[4] &&
         p[2] <= box[5];
}

/* Closest facet among the boxes of a cell whose normal opposes `outward`; -1: none. */
static int32_t closest_in_cell(const wr_target *target, const wr_grid *grid, int64_t cell,
                               const double *xv, const double *p, const double *outward, double tie,
                               hit_t *best) {
  int32_t found = -1;
  hit_t h;
  best->d = INFINITY;
  for (int64_t e = grid->start[cell]; e < grid->start[cell + 1]; e++) {
    const int32_t g = grid->pick[grid->entry[e]];
    if (!inside(grid->box + 6 * (size_t)grid->entry[e], p))
      continue;
    h.xi[0] = h.xi[1] = 0.0;
    closest(xv, target->quad + 4 * (size_t)g, p, &h);
    if (!(dot3(h.n, outward) < 0.0))
      continue;
    if (found < 0 || closer(&h, best, tie)) {
      *best = h;
      found = g;
    }
  }
  return found;
}

void wr_search(const wr_target *target, const wr_grid *grid, const double *xv, double above,
               double below, const double *stiffness, wr_candidates *near) {
  int64_t hits = 0;
  for (int64_t i = 0; i < near->k; i++) {
    const size_t c = (size_t)near->item[i];
    const double *p = xv + 6 * c;
    int64_t cell = 0;
    for (int a = 0; a < 3; a++)
      cell = cell * grid->dims[a] + slot(p[a], grid->origin[a], grid->edge, grid->dims[a]);
    hit_t best;
    const int32_t found =
        closest_in_cell(target, grid, cell, xv, p, near->outward + 3 * c, TIE * above, &best);
    const int held = stiffness[c] > 0.0;
    if (found < 0 || !(best.d <= (held || best.side >= 0.0 ? above : below)))
      continue;
    near->item[hits++] = (int32_t)c;
    if (!held) {
      near->facet[c] = found;
      memcpy(near->xi + 2 * c, best.xi, sizeof best.xi);
    }
    near->live[near->facet[c]] = 1;
    for (int64_t e = grid->start[cell]; e < grid->start[cell + 1]; e++)
      if (inside(grid->box + 6 * (size_t)grid->entry[e], p))
        near->live[grid->pick[grid->entry[e]]] = 1;
  }
  near->k = hits;
}

/* Must the neighbours be looked at? Inside a convex target the closest facet can change before
 * the foot leaves the present one: within depth * tan(half the angle) of the edge. */
static inline int unsure(const hit_t *h, uint8_t kind, double size) {
  if (h->edges || (kind & WR_SHARP))
    return 1;
  if (h->side >= 0.0)
    return 0;
  const double band = 1.0 + 2.0 * h->side / size;
  return fabs(h->xi[0]) > band || fabs(h->xi[1]) > band;
}

/* What tracking reads; see kernel.h. */
typedef struct {
  const wr_target *target;
  const double *xv, *outward;
  const uint8_t *live;
} track_t;

/* The closest facet round the one tracked so far; returns it. */
static int32_t closest_facet(const track_t *k, size_t c, int32_t f, hit_t *best) {
  const wr_target *t = k->target;
  const double *p = k->xv + 6 * c;
  hit_t h;
  closest(k->xv, t->quad + 4 * (size_t)f, p, best);
  for (int hop = 0; hop < MAX_HOPS && unsure(best, t->kind[f], t->size[f]); hop++) {
    const int32_t from = f, *nodes = t->quad + 4 * (size_t)f;
    for (int a = 0; a < 4; a++)
      for (int32_t e = t->around[nodes[a]]; e < t->around[nodes[a] + 1]; e++) {
        const int32_t g = t->ring[e];
        if (g == f || g == from || !k->live[g])
          continue;
        h.xi[0] = h.xi[1] = 0.0;
        closest(k->xv, t->quad + 4 * (size_t)g, p, &h);
        if (!(dot3(h.n, k->outward + 3 * c) < 0.0) || !closer(&h, best, TIE * t->size[from]))
          continue;
        *best = h;
        f = g;
      }
    if (f == from)
      break;
  }
  return f;
}

/* Closest point on flat-sided (bilinear) facets. Returns 1 where a curved facet may take over. */
static int track_faceted(const track_t *k, size_t c, int32_t *facet, double *xi, double *gap,
                         double *n) {
  const wr_target *t = k->target;
  hit_t best = {.xi = {xi[0], xi[1]}};
  const int32_t f = *facet = closest_facet(k, c, *facet, &best);
  memcpy(xi, best.xi, sizeof best.xi);
  memcpy(n, best.n, sizeof best.n);
  const int border = best.edges & t->kind[f] & 15;
  *gap = best.side;
  if (beyond_border(k->xv, t->quad + 4 * (size_t)f, t->kind[f], k->xv + 6 * c, &best)) {
    *gap = INFINITY;
    return 0;
  }
  if (!best.edges || border || !(best.d > TIE * t->size[f]))
    return 1;
  /* over an edge or vertex the distance itself is the gap: its gradient is the direction to
   * the node, so the force stays conservative and free of moment */
  *gap = best.side < 0.0 ? -best.d : best.d;
  for (int a = 0; a < 3; a++)
    n[a] = best.r[a] / *gap;
  return 1;
}
