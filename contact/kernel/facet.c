/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Closest point of one facet. */
#define BORDER                                                                                     \
  1.0e-2           /* a node this far (in xi) beyond the open border still counts: border nodes    \
                          of matching meshes must not flicker with the lateral strain */
#define TIE 1.0e-9 /* distances closer than this part of the facet's size are equal */
#define MAX_HOPS 32

typedef struct {
  double xi[2], r[3], n[3]; /* closest point, vector from it to the node, facet normal */
  double d, side;           /* distance, r . n */
  int edges;                /* bit e: clamped on edge e */
} hit_t;

static inline double dot3(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross3(const double *a, const double *b, double *c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void shape4(const double *xi, double *N) {
  const double a = 1.0 - xi[0], b = 1.0 + xi[0], c = 1.0 - xi[1], d = 1.0 + xi[1];
  N[0] = 0.25 * a * c;
  N[1] = 0.25 * b * c;
  N[2] = 0.25 * b * d;
  N[3] = 0.25 * a * d;
}

/* y(xi) = m[0] + m[1] xi0 + m[2] xi1 + m[3] xi0 xi1 */
static inline void monomials(const double *xv, const int32_t *quad, double m[4][3]) {
  const double *a = xv + 6 * (size_t)quad[0], *b = xv + 6 * (size_t)quad[1];
  const double *c = xv + 6 * (size_t)quad[2], *d = xv + 6 * (size_t)quad[3];
  for (int i = 0; i < 3; i++) {
    m[0][i] = 0.25 * ((a[i] + b[i]) + (c[i] + d[i]));
    m[1][i] = 0.25 * ((b[i] - a[i]) + (c[i] - d[i]));
    m[2][i] = 0.25 * ((d[i] - a[i]) + (c[i] - b[i]));
    m[3][i] = 0.25 * ((a[i] - b[i]) + (c[i] - d[i]));
  }
}

static inline void residual(double m[4][3], const double *p, const double *xi, double *r,
                            double *t1, double *t2) {
  for (int i = 0; i < 3; i++) {
    t1[i] = m[1][i] + xi[1] * m[3][i];
    t2[i] = m[2][i] + xi[0] * m[3][i];
    r[i] = p[i] - (m[0][i] + xi[0] * t1[i] + xi[1] * m[2][i]);
  }
}

/* Newton for the foot of the perpendicular. Returns 1 when it lies on the facet. */
static int foot(double m[4][3], const double *p, double *xi) {
  double r[3], t1[3], t2[3];
  for (int it = 0; it < 20; it++) {
    residual(m, p, xi, r, t1, t2);
    const double a = dot3(t1, t1), b = dot3(t2, t2), g = dot3(r, t1), h = dot3(r, t2);
    double c = dot3(t1, t2) - dot3(r, m[3]), det = a * b - c * c;
    if (!(det > 1e-2 * a * b)) { /* not convex here: Gauss-Newton step */
      c = dot3(t1, t2);
      det = a * b - c * c;
    }
    if (!(det > 1e-12 * a * b))
      return 0;
    const double d0 = (b * g - c * h) / det, d1 = (a * h - c * g) / det;
    xi[0] += d0;
    xi[1] += d1;
    if (!(fabs(xi[0]) < 3.0 && fabs(xi[1]) < 3.0))
      return 0;
    /* quadratic convergence: the step after one of 1e-7 is round-off */
    if (fabs(d0) < 1e-7 && fabs(d1) < 1e-7)
      return fabs(xi[0]) <= 1.0 && fabs(xi[1]) <= 1.0;
  }
  return 0;
}

/* Closest point on the four (straight) edges; returns the clamped edges as bits. */
static int rim(const double *xv, const int32_t *quad, const double *p, double *xi) {
  static const double from[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
  double best = INFINITY;
  int edges = 0;
  for (int e = 0; e < 4; e++) {
    const double *a = xv + 6 * (size_t)quad[e], *b = xv + 6 * (size_t)quad[(e + 1) & 3];
    const double t[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double q[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    double s = dot3(q, t) / dot3(t, t);
    s = s > 0.0 ? (s < 1.0 ? s : 1.0) : 0.0;
    const double r[3] = {q[0] - s * t[0], q[1] - s * t[1], q[2] - s * t[2]};
    const double d = dot3(r, r);
    if (!(d < best))
      continue;
    best = d;
    edges = 1 << e;
    if (s == 0.0)
      edges |= 1 << ((e + 3) & 3);
    if (s == 1.0)
      edges |= 1 << ((e + 1) & 3);
    for (int i = 0; i < 2; i++)
      xi[i] = (1.0 - s) * from[e][i] + s * from[(e + 1) & 3][i];
  }
  return edges;
}

/* Closest point of one facet, clamped to it, starting from h->xi. */
static void closest(const double *xv, const int32_t *quad, const double *p, hit_t *h) {
  double m[4][3], t1[3], t2[3];
  monomials(xv, quad, m);
  h->edges = foot(m, p, h->xi) ? 0 : rim(xv, quad, p, h->xi);
  residual(m, p, h->xi, h->r, t1, t2);
  cross3(t1, t2, h->n);
  const double s = 1.0 / sqrt(dot3(h->n, h->n));
  for (int i = 0; i < 3; i++)
    h->n[i] *= s;
  h->d = sqrt(dot3(h->r, h->r));
  h->side = dot3(h->r, h->n);
}

/* Of two equally close facets the one seen more head-on gives the right sign of the gap. */
static inline int closer(const hit_t *a, const hit_t *b, double tie) {
  if (a->d < b->d - tie)
    return 1;
  return a->d <= b->d + tie && fabs(a->side) > fabs(b->side) + tie;
}

/* 1 when the node lies beyond an edge of the facet that has no neighbour. */
static int beyond_border(const double *xv, const int32_t *quad, uint8_t kind, const double *p,
                         const hit_t *h) {
  const int edges = h->edges & kind & 15;
  if (!edges)
    return 0;
  double m[4][3], r[3], t1[3], t2[3];
  monomials(xv, quad, m);
  residual(m, p, h->xi, r, t1, t2);
  const double a = dot3(r, t1) / dot3(t1, t1), b = dot3(r, t2) / dot3(t2, t2);
  return ((edges & 1) && -b > BORDER) || ((edges & 2) && a > BORDER) ||
         ((edges & 4) && b > BORDER) || ((edges & 8) && -a > BORDER);
}
