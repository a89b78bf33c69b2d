/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* What of two surfaces can come near, told by boxes; and closest points as rows, for other ranks. */

static inline void open_box(double *box) {
  for (int a = 0; a < 3; a++) {
    box[a] = INFINITY;
    box[3 + a] = -INFINITY;
  }
}

static inline void widen(double *box, const double *p) {
  for (int a = 0; a < 3; a++) {
    box[a] = p[a] < box[a] ? p[a] : box[a];
    box[3 + a] = p[a] > box[3 + a] ? p[a] : box[3 + a];
  }
}

void wr_bounds(int64_t k, const double *xv, double *box) {
  open_box(box);
  for (int64_t i = 0; i < k; i++)
    widen(box, xv + 6 * i);
}

double wr_fastest(int64_t k, const double *xv, const double *v) {
  double most = 0.0;
  for (int64_t i = 0; i < k; i++) {
    double sum = 0.0;
    for (int a = 0; a < 3; a++)
      sum += (xv[6 * i + 3 + a] - v[a]) * (xv[6 * i + 3 + a] - v[a]);
    most = sum > most ? sum : most;
  }
  return sqrt(most);
}

int64_t wr_within(int64_t k, const double *xv, const double *box, int32_t *item) {
  int64_t count = 0;
  for (int64_t i = 0; i < k; i++)
    if (inside(box, xv + 6 * i))
      item[count++] = (int32_t)i;
  return count;
}

int64_t wr_facets_within(const wr_target *target, int64_t q, const double *xv, double pad,
                         const double *box, int32_t *pick, double *boxes) {
  int64_t count = 0;
  for (int64_t f = 0; f < q; f++) {
    double *mine = boxes + 6 * count;
    int meets = 1;
    open_box(mine);
    for (int b = 0; b < 4; b++)
      widen(mine, xv + 6 * (size_t)target->quad[4 * f + b]);
    for (int a = 0; a < 3; a++) {
      mine[a] -= pad;
      mine[3 + a] += pad;
      meets = meets && mine[3 + a] >= box[a] && mine[a] <= box[3 + a];
    }
    if (meets)
      pick[count++] = (int32_t)f;
  }
  return count;
}

/* Are all the nodes of a facet far away? */
static inline int far_off(const uint8_t *near, const int32_t *nodes) {
  return !(near[nodes[0]] | near[nodes[1]] | near[nodes[2]] | near[nodes[3]]);
}

void wr_outward(int64_t q, const int32_t *quad, const uint8_t *near, int64_t nc, const double *xv,
                double *outward) {
  memset(outward, 0, (size_t)nc * 3 * sizeof *outward);
  for (int64_t f = 0; f < q; f++) {
    const int32_t *nodes = quad + 4 * f;
    if (far_off(near, nodes))
      continue;
    double d[2][3], area[3];
    for (int a = 0; a < 3; a++) {
      d[0][a] = xv[6 * (size_t)nodes[2] + (size_t)a] - xv[6 * (size_t)nodes[0] + (size_t)a];
      d[1][a] = xv[6 * (size_t)nodes[3] + (size_t)a] - xv[6 * (size_t)nodes[1] + (size_t)a];
    }
    cross3(d[0], d[1], area);
    for (int b = 0; b < 4; b++)
      for (int a = 0; a < 3; a++)
        outward[3 * (size_t)nodes[b] + (size_t)a] += area[a];
  }
  for (int64_t c = 0; c < nc; c++) {
    double *n = outward + 3 * c;
    const double size = sqrt(dot3(n, n));
    for (int a = 0; a < 3 && size > 0.0; a++)
      n[a] /= size;
  }
}

void wr_pack(const wr_candidates *near, const wr_state *state, double *row) {
  for (int64_t i = 0; i < near->k; i++, row += WR_ROW) {
    const size_t c = (size_t)near->item[i];
    row[0] = (double)state->facet[c];
    row[1] = state->gap[c];
    memcpy(row + 2, state->xi + 2 * c, 2 * sizeof *row);
    memcpy(row + 4, state->normal + 3 * c, 3 * sizeof *row);
  }
}

void wr_unpack(const wr_candidates *near, const double *row, wr_state *state) {
  for (int64_t i = 0; i < near->k; i++, row += WR_ROW) {
    const size_t c = (size_t)near->item[i];
    state->facet[c] = (int32_t)row[0];
    state->gap[c] = row[1];
    memcpy(state->xi + 2 * c, row + 2, 2 * sizeof *row);
    memcpy(state->normal + 3 * c, row + 4, 3 * sizeof *row);
  }
}
