/* SPDX-License-Identifier: LGPL-3.0-or-later */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "kernel.h"

#define SHARP 16 /* bit of kind */
#define BORDER                                                                                     \
  1.0e-2           /* a node this far (in xi) beyond the open border still counts: border nodes
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

int64_t wr_buckets(int64_t m, const double *box, const double *grid, const int64_t *dims,
                   int64_t *cursor, int32_t *entry) {
  int64_t count = 0, low[3], high[3];
  for (int64_t i = 0; i < m; i++) {
    for (int a = 0; a < 3; a++) {
      low[a] = slot(box[6 * i + a], grid[a], grid[3], dims[a]);
      high[a] = slot(box[6 * i + 3 + a], grid[a], grid[3], dims[a]);
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

int64_t wr_search(int64_t k, const int32_t *item, const double *xv, const double *outward,
                  const int32_t *quad, const int32_t *pick, const double *box, const double *grid,
                  const int64_t *dims, const int64_t *start, const int32_t *entry, double above,
                  double below, const double *stiffness, int32_t *facet, double *xi, uint8_t *hit,
                  uint8_t *live) {
  int64_t hits = 0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    const double *p = xv + 6 * c;
    int64_t cell = 0;
    for (int a = 0; a < 3; a++)
      cell = cell * dims[a] + slot(p[a], grid[a], grid[3], dims[a]);
    hit_t best = {.d = INFINITY}, h;
    int32_t found = -1;
    for (int64_t e = start[cell]; e < start[cell + 1]; e++) {
      const int32_t g = pick[entry[e]];
      if (!inside(box + 6 * (size_t)entry[e], p))
        continue;
      h.xi[0] = h.xi[1] = 0.0;
      closest(xv, quad + 4 * (size_t)g, p, &h);
      if (!(dot3(h.n, outward + 3 * c) < 0.0))
        continue;
      if (found < 0 || closer(&h, &best, TIE * above)) {
        best = h;
        found = g;
      }
    }
    const int held = stiffness[c] > 0.0;
    hit[i] = found >= 0 && best.d <= (held || best.side >= 0.0 ? above : below);
    if (!hit[i])
      continue;
    hits++;
    if (!held) {
      facet[c] = found;
      memcpy(xi + 2 * c, best.xi, sizeof best.xi);
    }
    live[facet[c]] = 1;
    for (int64_t e = start[cell]; e < start[cell + 1]; e++)
      if (inside(box + 6 * (size_t)entry[e], p))
        live[pick[entry[e]]] = 1;
  }
  return hits;
}

/* Must the neighbours be looked at? Inside a convex target the closest facet can change before
 * the foot leaves the present one: within depth * tan(half the angle) of the edge. */
static inline int unsure(const hit_t *h, uint8_t kind, double size) {
  if (h->edges || (kind & SHARP))
    return 1;
  if (h->side >= 0.0)
    return 0;
  const double band = 1.0 + 2.0 * h->side / size;
  return fabs(h->xi[0]) > band || fabs(h->xi[1]) > band;
}

int64_t wr_track(int64_t k, const int32_t *item, const double *xv, const int32_t *quad,
                 const uint8_t *kind, const double *size, const int32_t *around,
                 const int32_t *ring, const uint8_t *live, const double *outward, int32_t *facet,
                 double *xi, double *gap, double *normal) {
  int64_t inside_count = 0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    const double *p = xv + 6 * c;
    int32_t f = facet[c];
    hit_t best = {.xi = {xi[2 * c], xi[2 * c + 1]}}, h;
    closest(xv, quad + 4 * (size_t)f, p, &best);
    for (int hop = 0; hop < MAX_HOPS && unsure(&best, kind[f], size[f]); hop++) {
      const int32_t from = f, *nodes = quad + 4 * (size_t)f;
      for (int a = 0; a < 4; a++)
        for (int32_t e = around[nodes[a]]; e < around[nodes[a] + 1]; e++) {
          const int32_t g = ring[e];
          if (g == f || g == from || !live[g])
            continue;
          h.xi[0] = h.xi[1] = 0.0;
          closest(xv, quad + 4 * (size_t)g, p, &h);
          if (!(dot3(h.n, outward + 3 * c) < 0.0) || !closer(&h, &best, TIE * size[from]))
            continue;
          best = h;
          f = g;
        }
      if (f == from)
        break;
    }
    facet[c] = f;
    memcpy(xi + 2 * c, best.xi, sizeof best.xi);
    const int border = best.edges & kind[f] & 15;
    if (beyond_border(xv, quad + 4 * (size_t)f, kind[f], p, &best)) {
      gap[c] = INFINITY;
    } else if (best.edges && !border && best.d > TIE * size[f]) {
      /* over an edge or vertex the distance itself is the gap: its gradient is the direction to
       * the node, so the force stays conservative and free of moment */
      gap[c] = best.side < 0.0 ? -best.d : best.d;
      for (int a = 0; a < 3; a++)
        best.n[a] = best.r[a] / gap[c];
    } else {
      gap[c] = best.side;
    }
    memcpy(normal + 3 * c, best.n, sizeof best.n);
    inside_count += gap[c] < 0.0;
  }
  return inside_count;
}

/* Shape functions, point, arm r (closest point to node) and, unless rigid, the facet's inverse
 * inertia (unit masses about the centroid, symmetric: xx yy zz yz xz xy). Returns 0 if rigid. */
static int lever(const double *xv, const double *mass, const int32_t *quad, const double *p,
                 const double *xi, double back, double *N, double *r, double R[4][3],
                 double *inverse) {
  double m[3] = {0, 0, 0}, y[3] = {0, 0, 0}, J[6] = {0, 0, 0, 0, 0, 0};
  double s[3] = {p[0] - back * p[3], p[1] - back * p[4], p[2] - back * p[5]};
  shape4(xi, N);
  for (int i = 0; i < 4; i++) {
    const double *w = xv + 6 * (size_t)quad[i];
    for (int a = 0; a < 3; a++) {
      R[i][a] = w[a] - back * w[a + 3];
      m[a] += 0.25 * R[i][a];
      y[a] += N[i] * R[i][a];
    }
  }
  for (int a = 0; a < 3; a++)
    r[a] = s[a] - y[a];
  if (isinf(mass[quad[0]]))
    return 0;
  for (int i = 0; i < 4; i++) {
    for (int a = 0; a < 3; a++)
      R[i][a] -= m[a];
    const double *q = R[i];
    J[0] += q[1] * q[1] + q[2] * q[2];
    J[1] += q[2] * q[2] + q[0] * q[0];
    J[2] += q[0] * q[0] + q[1] * q[1];
    J[3] -= q[1] * q[2];
    J[4] -= q[2] * q[0];
    J[5] -= q[0] * q[1];
  }
  inverse[0] = J[1] * J[2] - J[3] * J[3];
  inverse[1] = J[0] * J[2] - J[4] * J[4];
  inverse[2] = J[0] * J[1] - J[5] * J[5];
  inverse[3] = J[4] * J[5] - J[0] * J[3];
  inverse[4] = J[3] * J[5] - J[1] * J[4];
  inverse[5] = J[3] * J[4] - J[2] * J[5];
  const double det = J[0] * inverse[0] + J[5] * inverse[5] + J[4] * inverse[4];
  for (int a = 0; a < 6; a++)
    inverse[a] /= det;
  return det > 0.0;
}

static inline void solve(const double *inverse, const double *b, double *x) {
  x[0] = inverse[0] * b[0] + inverse[5] * b[1] + inverse[4] * b[2];
  x[1] = inverse[5] * b[0] + inverse[1] * b[1] + inverse[3] * b[2];
  x[2] = inverse[4] * b[0] + inverse[3] * b[1] + inverse[2] * b[2];
}

/* Velocity of the node relative to the facet, free of the facet's spin (conjugate to the force
 * that wr_friction applies); `spin` is the facet's mean angular velocity. Both are taken half a
 * step back, where the velocities live: rigid rotations of any size then give exactly zero. */
static void relative(const double *xv, const double *mass, const int32_t *quad, const double *p,
                     const double *xi, double dt, double *w, double *spin) {
  double N[4], r[3], R[4][3], inverse[6], L[3] = {0, 0, 0}, t[3];
  const int deformable = lever(xv, mass, quad, p, xi, 0.5 * dt, N, r, R, inverse);
  memcpy(w, p + 3, 3 * sizeof(double));
  spin[0] = spin[1] = spin[2] = 0.0;
  for (int i = 0; i < 4; i++) {
    const double *v = xv + 6 * (size_t)quad[i] + 3;
    for (int a = 0; a < 3; a++)
      w[a] -= N[i] * v[a];
    cross3(R[i], v, t);
    for (int a = 0; a < 3; a++)
      L[a] += t[a];
  }
  if (!deformable)
    return;
  solve(inverse, L, spin);
  cross3(spin, r, t);
  for (int a = 0; a < 3; a++)
    w[a] -= t[a];
}

/* Turns t with the facet (Cayley's formula, exact for rigid rotation) and lays it into the plane
 * normal to n, keeping its length. */
static void carry(const double *spin, double dt, const double *n, double *t) {
  const double length = sqrt(dot3(t, t));
  if (!(length > 0.0))
    return;
  const double h[3] = {0.5 * dt * spin[0], 0.5 * dt * spin[1], 0.5 * dt * spin[2]};
  double a[3], b[3];
  cross3(h, t, a);
  cross3(h, a, b);
  const double s = 2.0 / (1.0 + dot3(h, h));
  for (int i = 0; i < 3; i++)
    t[i] += s * (a[i] + b[i]);
  const double along = dot3(t, n);
  for (int i = 0; i < 3; i++)
    t[i] -= along * n[i];
  const double left = sqrt(dot3(t, t));
  const double scale = left > 1e-9 * length ? length / left : 0.0;
  for (int i = 0; i < 3; i++)
    t[i] *= scale;
}

/* 1 / m_eff = 1 / m_c + crowd * sum N_i / m_i: an upper bound of sum N_i^2 / m_i that does not
 * depend on where the node lands; `crowd` contactor nodes share the mass of one target node. */
static double effective_mass(const double *mass, const double *area, const int32_t *quad,
                             const double *xi, size_t c) {
  double N[4], inverse = 0.0, tributary = 0.0;
  shape4(xi, N);
  for (int i = 0; i < 4; i++) {
    inverse += N[i] / mass[quad[i]];
    tributary += N[i] * area[quad[i]];
  }
  return 1.0 / (1.0 / mass[c] + inverse * fmax(1.0, tributary / area[c]));
}

int64_t wr_normal(int64_t k, const int32_t *item, double dt, double per_mass, double lag,
                  double ratio, const double *xv, const double *mass, const double *area,
                  const int32_t *quad, const int32_t *facet, const double *xi, const double *gap,
                  double *normal, double *stiffness, double *pressing, double *drag,
                  double *traction, double *slip, int32_t *touching, double *total) {
  int64_t count = 0;
  for (int a = 2; a < 12; a++)
    total[a] = 0.0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    double *t = traction + 3 * c, *s = slip + 3 * c, w[3], spin[3];
    if (gap[c] >= 0.0) { /* NaN stays in contact, so that the guards see it */
      if (stiffness[c] > 0.0)
        total[0] += 0.5 * dot3(t, t) / (ratio * stiffness[c]);
      stiffness[c] = pressing[c] = drag[c] = 0.0;
      t[0] = t[1] = t[2] = s[0] = s[1] = s[2] = 0.0;
      continue;
    }
    const double *n = normal + 3 * c, *p = xv + 6 * c;
    const int32_t *nodes = quad + 4 * (size_t)facet[c];
    touching[count++] = (int32_t)c;
    relative(xv, mass, nodes, p, xi + 2 * c, dt, w, spin);
    const double closing = -dot3(w, n);
    const int born = stiffness[c] == 0.0;
    if (born)
      stiffness[c] = per_mass * effective_mass(mass, area, nodes, xi + 2 * c, c);
    carry(spin, dt, n, t);
    for (int a = 0; a < 3; a++)
      s[a] = born ? 0.0 : dt * (w[a] + closing * n[a]);
    /* penalty spring and dashpot, never tension */
    const double spring = -stiffness[c] * gap[c], push = lag * stiffness[c] * closing;
    const double old = drag[c];
    pressing[c] = push < -spring ? 0.0 : spring + push;
    drag[c] = pressing[c] - spring;
    total[1] += 0.5 * (old + drag[c]) * closing * dt; /* trapezoidal, as the leapfrog's work */
  }
  return count;
}

/* Radial return of the trial traction; returns 1 for stick. */
static int return_map(double kt, double limit, const double *s, double *t, double *total) {
  double trial[3], old[3] = {t[0], t[1], t[2]};
  for (int a = 0; a < 3; a++)
    trial[a] = t[a] - kt * s[a];
  const double size = sqrt(dot3(trial, trial));
  const int stick = size <= limit;
  const double scale = stick ? 1.0 : limit / size;
  for (int a = 0; a < 3; a++) {
    t[a] = scale * trial[a];
    /* trapezoidal work of the plastic slip (trial - t) / kt: closes the leapfrog's balance */
    total[0] += 0.5 * (old[a] + t[a]) * (trial[a] - t[a]) / kt;
  }
  total[3] += 0.5 * dot3(t, t) / kt;
  return stick;
}

int64_t wr_friction(int64_t k, const int32_t *touching, double ratio, const double *friction,
                    const double *xv, const double *mass, const int32_t *dof, const int32_t *quad,
                    const int32_t *facet, const double *xi, const double *gap, const double *normal,
                    const double *stiffness, const double *pressing, const double *slip,
                    double *traction, double *f, double *total) {
  int64_t sticking = 0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)touching[i];
    const int32_t *nodes = quad + 4 * (size_t)facet[c];
    const double *n = normal + 3 * c, *t = traction + 3 * c;
    double N[4], r[3], R[4][3], inverse[6], F[3], M[3], A[3], extra[3] = {0, 0, 0};
    sticking += return_map(ratio * stiffness[c], friction[c] * pressing[c], slip + 3 * c,
                           traction + 3 * c, total);
    for (int a = 0; a < 3; a++) {
      F[a] = pressing[c] * n[a] + t[a];
      total[6 + a] += pressing[c] * n[a];
      total[9 + a] += t[a];
    }
    total[2] += 0.5 * stiffness[c] * gap[c] * gap[c];
    total[4] = fmax(total[4], -gap[c]);
    total[5] += pressing[c];
    if (dof[c] >= 0)
      for (int a = 0; a < 3; a++)
        f[3 * (size_t)dof[c] + a] += F[a];
    if (!lever(xv, mass, nodes, xv + 6 * c, xi + 2 * c, 0.0, N, r, R, inverse))
      continue;
    /* the reaction acts at the closest point, the force at the node: a self-equilibrated couple
     * on the facet, forces A x R_i with J A = M, balances the moment M of the pair */
    cross3(F, r, M);
    solve(inverse, M, A);
    for (int b = 0; b < 4; b++) {
      if (dof[nodes[b]] < 0)
        continue;
      cross3(A, R[b], extra);
      for (int a = 0; a < 3; a++)
        f[3 * (size_t)dof[nodes[b]] + a] += extra[a] - N[b] * F[a];
    }
  }
  return sticking;
}
