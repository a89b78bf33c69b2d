/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Smooth target: facets curved by the normals at their corners. */

#define ENOUGH 1.0e-5 /* Newton step (in xi) after which the error is its square */

typedef struct {
  double x[4][3], n[4][3];
} patch_t;

static void patch_of(const wr_target *t, const double *xv, int32_t f, patch_t *s) {
  for (int i = 0; i < 4; i++) {
    memcpy(s->x[i], xv + 6 * (size_t)t->quad[4 * (size_t)f + i], sizeof s->x[i]);
    memcpy(s->n[i], t->normals + 3 * (size_t)t->corner[4 * (size_t)f + i], sizeof s->n[i]);
  }
}

/* Point and direction at xi, each with its two derivatives. With p on the bilinear facet the
 * point is p - 1/2 sum N_i ((p - x_i) . n_i) n_i: half way to the tangent planes of the corners,
 * which is exact for paraboloids. On an edge both depend on its two ends only, so neighbours that
 * share corner normals meet without a crack or a kink of the direction. */
static void curved(const patch_t *s, const double *xi, double y[3][3], double d[3][3]) {
  const double a = 0.25 * (1.0 - xi[0]), b = 0.25 * (1.0 + xi[0]);
  const double e = 1.0 - xi[1], f = 1.0 + xi[1];
  const double N[3][4] = {
      {a * e, b * e, b * f, a * f}, {-0.25 * e, 0.25 * e, 0.25 * f, -0.25 * f}, {-a, -b, b, a}};
  double p[3][3];
  for (int k = 0; k < 3; k++)
    for (int j = 0; j < 3; j++) {
      p[k][j] = (N[k][0] * s->x[0][j] + N[k][1] * s->x[1][j]) +
                (N[k][2] * s->x[2][j] + N[k][3] * s->x[3][j]);
      d[k][j] = (N[k][0] * s->n[0][j] + N[k][1] * s->n[1][j]) +
                (N[k][2] * s->n[2][j] + N[k][3] * s->n[3][j]);
    }
  memcpy(y, p, sizeof p);
  for (int i = 0; i < 4; i++) {
    const double *n = s->n[i];
    const double q[3] = {p[0][0] - s->x[i][0], p[0][1] - s->x[i][1], p[0][2] - s->x[i][2]};
    const double high = 0.5 * dot3(q, n), half = 0.5 * N[0][i];
    const double c[3] = {N[0][i] * high, N[1][i] * high + half * dot3(p[1], n),
                         N[2][i] * high + half * dot3(p[2], n)};
    for (int k = 0; k < 3; k++)
      for (int j = 0; j < 3; j++)
        y[k][j] -= c[k] * n[j];
  }
}

/* Newton for xi and gap with node = point + gap * direction. Returns 0 when there is none near. */
static int curved_foot(const patch_t *s, const double *p, double *xi, double *gap, double *n) {
  double y[3][3], d[3][3], r[3], a[3], b[3], ab[3], bd[3], da[3], g = 0.0;
  for (int it = 0; it < 12; it++) {
    curved(s, xi, y, d);
    for (int j = 0; j < 3; j++)
      r[j] = p[j] - y[0][j];
    if (!it)
      g = dot3(r, d[0]) / dot3(d[0], d[0]);
    for (int j = 0; j < 3; j++) {
      r[j] -= g * d[0][j];
      a[j] = y[1][j] + g * d[1][j];
      b[j] = y[2][j] + g * d[2][j];
    }
    cross3(b, d[0], bd);
    cross3(d[0], a, da);
    cross3(a, b, ab);
    const double det = 1.0 / dot3(a, bd), u = det * dot3(r, bd), v = det * dot3(r, da);
    xi[0] += u;
    xi[1] += v;
    g += det * dot3(r, ab);
    if (!(fabs(xi[0]) < 3.0 && fabs(xi[1]) < 3.0))
      return 0;
    if (fabs(u) > ENOUGH || fabs(v) > ENOUGH)
      continue;
    for (int j = 0; j < 3; j++)
      n[j] = d[0][j] + u * d[1][j] + v * d[2][j];
    const double length = sqrt(dot3(n, n));
    for (int j = 0; j < 3; j++)
      n[j] /= length;
    *gap = g * length;
    return 1;
  }
  return 0;
}

/* Edge that xi lies farthest beyond, and by how much; -1: on the facet. */
static int crossed(const double *xi, double *by) {
  const double beyond[4] = {-1.0 - xi[1], xi[0] - 1.0, xi[1] - 1.0, -1.0 - xi[0]};
  int edge = -1;
  *by = 0.0;
  for (int e = 0; e < 4; e++)
    if (beyond[e] > *by) {
      *by = beyond[e];
      edge = e;
    }
  return edge;
}

/* Walks over smooth edges to the curved facet that the node stands over. Returns 0 when it comes
 * to a sharp edge or finds none: then the bilinear facets decide. */
static int track_curved(const track_t *k, size_t c, int32_t *facet, double *xi, double *gap,
                        double *n) {
  const wr_target *t = k->target;
  const double *p = k->xv + 6 * c;
  double z[2] = {xi[0], xi[1]}, g, m[3], by;
  int32_t f = *facet, came = -1;
  patch_t s;
  for (int hop = 0; hop < MAX_HOPS; hop++) {
    patch_of(t, k->xv, f, &s);
    if (!curved_foot(&s, p, z, &g, m) || !(dot3(m, k->outward + 3 * c) < 0.0))
      return 0;
    const int edge = crossed(z, &by);
    const int32_t next = edge < 0 ? -1 : t->across[4 * (size_t)f + edge];
    if (edge >= 0 && (next < 0 ? !(t->kind[f] >> edge & 1) : next != came && !k->live[next]))
      return 0;
    if (edge < 0 || next < 0 || next == came) { /* came back: on the edge, within round-off */
      *gap = next < 0 && edge >= 0 && by > 2.0 * BORDER ? INFINITY : g;
      *facet = f;
      for (int a = 0; a < 2; a++)
        xi[a] = fmax(-1.0, fmin(1.0, z[a]));
      memcpy(n, m, sizeof m);
      return 1;
    }
    came = f;
    f = next;
    z[0] = z[1] = 0.0;
  }
  return 0;
}

int64_t wr_track(const wr_target *target, const wr_candidates *near, const double *xv,
                 wr_state *state) {
  const track_t t = {target, xv, near->outward, near->live};
  const int32_t *across = target->across;
  int64_t inside_count = 0;
  for (int64_t i = 0; i < near->k; i++) {
    const size_t c = (size_t)near->item[i];
    int32_t *f = state->facet + c;
    double *z = state->xi + 2 * c, *g = state->gap + c, *n = state->normal + 3 * c;
    if (!across || (target->kind[*f] & WR_SHARP) || !track_curved(&t, c, f, z, g, n)) {
      const int found = track_faceted(&t, c, f, z, g, n);
      if (across && found)
        track_curved(&t, c, f, z, g, n);
    }
    inside_count += *g < 0.0;
  }
  return inside_count;
}

/* Adds e1 x e2 / (|e1|^2 |e2|^2) of a corner: exact for a sphere (Max, Journal of Graphics Tools
 * 4(2), 1999), and on unequal chords of a circle. */
static void add_corner(const double *xv, const int32_t *quad, int i, double *n) {
  const double *o = xv + 6 * (size_t)quad[i], *p = xv + 6 * (size_t)quad[(i + 1) & 3];
  const double *q = xv + 6 * (size_t)quad[(i + 3) & 3];
  const double a[3] = {p[0] - o[0], p[1] - o[1], p[2] - o[2]};
  const double b[3] = {q[0] - o[0], q[1] - o[1], q[2] - o[2]};
  double w[3];
  cross3(a, b, w);
  const double scale = 1.0 / (dot3(a, a) * dot3(b, b));
  for (int j = 0; j < 3; j++)
    n[j] += scale * w[j];
}

static inline void unit(double *n) {
  const double s = 1.0 / sqrt(dot3(n, n));
  for (int j = 0; j < 3; j++)
    n[j] *= s;
}

void wr_normals(const wr_target *target, int64_t m, const int32_t *fresh, int64_t k,
                const int32_t *used, int64_t b, const int32_t *mirror, const double *xv) {
  const int32_t *quad = target->quad, *corner = target->corner;
  double *normals = target->normals;
  for (int64_t i = 0; i < k; i++)
    memset(normals + 3 * (size_t)used[i], 0, 3 * sizeof(double));
  for (int64_t i = 0; i < m; i++) {
    const size_t f = 4 * (size_t)fresh[i];
    for (int a = 0; a < 4; a++)
      add_corner(xv, quad + f, a, normals + 3 * (size_t)corner[f + a]);
  }
  for (int64_t i = 0; i < k; i++)
    unit(normals + 3 * (size_t)used[i]);
  /* at a border the average is one-sided; there the facet is taken for an arc, whose end normals
   * mirror each other */
  for (int64_t i = 0; i < b; i++) {
    const int32_t *w = mirror + 4 * i;
    double *n = normals + 3 * (size_t)w[0];
    if (!i || w[0] != mirror[4 * (i - 1)])
      n[0] = n[1] = n[2] = 0.0;
    const double *inner = normals + 3 * (size_t)w[2];
    const double *p = xv + 6 * (size_t)w[1], *q = xv + 6 * (size_t)w[3];
    const double e[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    const double s = 2.0 * dot3(inner, e) / dot3(e, e);
    for (int j = 0; j < 3; j++)
      n[j] += inner[j] - s * e[j];
    if (i + 1 == b || mirror[4 * (i + 1)] != w[0])
      unit(n);
  }
}
