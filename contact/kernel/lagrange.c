/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Forward-increment Lagrange multipliers (Carpenter, Taylor, Katona, Int. J. Numer. Meth. Eng. 32,
 * 103-128, 1991): forces at t such that no contact is open or overlaps at t + dt. */

typedef struct {
  double N[4], per_mass[5]; /* weights of the facet's nodes; 1 / mass of node and facet's nodes */
  double n[3], w[3], t[3];  /* normal, relative velocity without contact, tangential force */
  double gap, p, inverse, friction; /* gap at t + dt without contact, normal force, 1 / W */
} row_t;

_Static_assert(sizeof(row_t) == WR_ROW * sizeof(double), "WR_ROW is told to the caller");

void wr_predict(int64_t k, const int32_t *item, const int32_t *dof, const double *mass, double dt,
                double kick, const double *xv, const double *f, double *ahead) {
  for (int64_t i = 0; i < k; i++) {
    const size_t j = (size_t)item[i];
    const double *x = xv + 6 * j;
    const double s = dof[j] >= 0 ? kick / mass[j] : 0.0;
    for (int a = 0; a < 3; a++) {
      const double v = x[a + 3] + (dof[j] >= 0 ? s * f[3 * (size_t)dof[j] + a] : 0.0);
      ahead[6 * j + a + 3] = v;
      ahead[6 * j + a] = x[a] + dt * v;
    }
  }
}

double wr_overlap(int64_t k, const int32_t *touching, const double *xv, const int32_t *quad,
                  const int32_t *corner, const double *normals, const int32_t *facet,
                  const double *xi, const double *normal) {
  const target_t t = {.xv = xv, .quad = quad, .corner = corner, .normals = normals};
  double deepest = 0.0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)touching[i];
    double y[3][3], d[3][3], m[4][3], r[3];
    patch_t s;
    if (corner) {
      patch_of(&t, facet[c], &s);
      curved(&s, xi + 2 * c, y, d);
      for (int a = 0; a < 3; a++)
        r[a] = xv[6 * c + (size_t)a] - y[0][a];
    } else {
      monomials(xv, quad + 4 * (size_t)facet[c], m);
      residual(m, xv + 6 * c, xi + 2 * c, r, y[1], y[2]);
    }
    deepest = fmax(deepest, -dot3(r, normal + 3 * c));
  }
  return deepest;
}

/* Velocity of the node relative to the facet that the contact forces have given so far. */
static inline void given(const row_t *r, const double *dv, size_t c, const int32_t *nodes,
                         double *w) {
  const double *a = dv + 3 * (size_t)nodes[0], *b = dv + 3 * (size_t)nodes[1];
  const double *d = dv + 3 * (size_t)nodes[2], *e = dv + 3 * (size_t)nodes[3];
  for (int i = 0; i < 3; i++)
    w[i] = dv[3 * c + (size_t)i] -
           ((r->N[0] * a[i] + r->N[1] * b[i]) + (r->N[2] * d[i] + r->N[3] * e[i]));
}

/* Adds the velocities of an impulse on the node and against the facet. */
static inline void push(const row_t *r, double *dv, size_t c, const int32_t *nodes,
                        const double *impulse) {
  for (int i = 0; i < 3; i++)
    dv[3 * c + (size_t)i] += r->per_mass[0] * impulse[i];
  for (int b = 0; b < 4; b++) {
    const double s = r->N[b] * r->per_mass[b + 1];
    for (int i = 0; i < 3; i++)
      dv[3 * (size_t)nodes[b] + (size_t)i] -= s * impulse[i];
  }
}

/* Sets up the row of one contact, with the forces of the last step as the first guess. The spin of
 * the facet is that of the last step: without contact its nodes would fly apart. */
static void open_row(row_t *r, double dt, const double *xv, const double *ahead, const double *mass,
                     size_t c, const int32_t *nodes, const double *xi, const double *n, double gap,
                     double friction, double normal_force, const double *tangential_force) {
  double spin[3], W;
  shape4(xi, r->N);
  W = r->per_mass[0] = 1.0 / mass[c];
  relative(xv, mass, nodes, xv + 6 * c, xi, dt, r->w, spin);
  for (int a = 3; a < 6; a++)
    r->w[a - 3] += ahead[6 * c + (size_t)a] - xv[6 * c + (size_t)a];
  for (int b = 0; b < 4; b++) {
    const size_t j = 6 * (size_t)nodes[b];
    r->per_mass[b + 1] = 1.0 / mass[nodes[b]];
    W += r->N[b] * r->N[b] * r->per_mass[b + 1];
    for (size_t a = 3; a < 6; a++)
      r->w[a - 3] -= r->N[b] * (ahead[j + a] - xv[j + a]);
  }
  memcpy(r->n, n, sizeof r->n);
  memcpy(r->t, tangential_force, sizeof r->t);
  carry(spin, dt, n, r->t);
  r->gap = gap;
  r->p = normal_force;
  r->inverse = 1.0 / W;
  r->friction = friction;
}

/* One sweep of projected Gauss-Seidel; returns the largest move that it made [m]. */
static double sweep(int64_t m, row_t *row, const int32_t *touching, double dt, double kick,
                    const int32_t *quad, const int32_t *facet, double *dv) {
  double largest = 0.0;
  for (int64_t i = 0; i < m; i++) {
    row_t *r = row + i;
    const size_t c = (size_t)touching[i];
    const int32_t *nodes = quad + 4 * (size_t)facet[c];
    double w[3], old[3], impulse[3], moved = 0.0;
    given(r, dv, c, nodes, w);
    const double p = r->p - (r->gap / dt + dot3(w, r->n)) * r->inverse / kick, before = r->p;
    r->p = p > 0.0 ? p : 0.0;
    memcpy(old, r->t, sizeof old);
    const double limit = r->friction * r->p;
    if (limit > 0.0) { /* the force that would stop the slip, returned to the cone */
      for (int a = 0; a < 3; a++)
        w[a] += r->w[a];
      const double along = dot3(w, r->n);
      for (int a = 0; a < 3; a++)
        r->t[a] -= (w[a] - along * r->n[a]) * r->inverse / kick;
      const double size = sqrt(dot3(r->t, r->t));
      for (int a = 0; a < 3 && size > limit; a++)
        r->t[a] *= limit / size;
    } else {
      r->t[0] = r->t[1] = r->t[2] = 0.0;
    }
    for (int a = 0; a < 3; a++) {
      impulse[a] = kick * ((r->p - before) * r->n[a] + r->t[a] - old[a]);
      moved += impulse[a] * impulse[a];
    }
    push(r, dv, c, nodes, impulse);
    moved = dt * sqrt(moved) / r->inverse;
    if (moved > largest || isnan(moved))
      largest = moved;
  }
  return largest;
}

/* Work lost over the step that has just ended: trapezoidal, as the leapfrog's work. */
static void lose(double p_old, double p, const double *t_old, const double *t, double approach,
                 const double *slip, double *total) {
  total[1] += 0.5 * (p_old + p) * approach;
  for (int a = 0; a < 3; a++)
    total[0] -= 0.5 * (t_old[a] + t[a]) * slip[a];
}

/* What the steps of wr_lagrange share; see kernel.h. */
typedef struct {
  double dt, kick, fade;
  const double *friction, *xv, *ahead, *mass, *xi, *normal;
  const int32_t *dof, *quad, *facet;
  double *gap, *stiffness, *offset, *normal_force, *approach, *tangential_force, *slip, *dv, *f,
      *total;
  row_t *row;
  int32_t *touching;
} system_t;

static const double none[3] = {0.0, 0.0, 0.0};

/* Parts a relative velocity into the approach and the slip of a step. */
static void part(const double *w, const double *n, double dt, double *approach, double *slip) {
  const double along = dot3(w, n);
  *approach = -dt * along;
  for (int a = 0; a < 3; a++)
    slip[a] = dt * (w[a] - along * n[a]);
}

static void let_go(const system_t *s, size_t c) {
  lose(s->normal_force[c], 0.0, s->tangential_force + 3 * c, none, s->approach[c], s->slip + 3 * c,
       s->total);
  s->stiffness[c] = s->normal_force[c] = s->approach[c] = 0.0;
  memset(s->tangential_force + 3 * c, 0, sizeof none);
  memset(s->slip + 3 * c, 0, sizeof none);
}

/* Opens a row for each node that overlaps, or that its neighbours may push so far; returns their
 * number and the deepest overlap. */
static int64_t open_rows(const system_t *s, int64_t k, const int32_t *item, double *deep) {
  int64_t m = 0;
  *deep = 0.0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    if (s->gap[c] >= 0.0)
      s->offset[c] = 0.0;
    s->gap[c] += s->fade * s->offset[c];
    *deep = fmax(*deep, -s->gap[c]);
  }
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    const int32_t *nodes = s->quad + 4 * (size_t)s->facet[c];
    if (s->gap[c] >= *deep) {
      if (s->stiffness[c] > 0.0)
        let_go(s, c);
      continue;
    }
    open_row(s->row + m, s->dt, s->xv, s->ahead, s->mass, c, nodes, s->xi + 2 * c,
             s->normal + 3 * c, s->gap[c], s->friction[c], s->normal_force[c],
             s->tangential_force + 3 * c);
    memset(s->dv + 3 * c, 0, sizeof none);
    for (int b = 0; b < 4; b++)
      memset(s->dv + 3 * (size_t)nodes[b], 0, sizeof none);
    s->touching[m++] = (int32_t)c;
  }
  return m;
}

/* Takes over the solution and applies its forces; returns the number of nodes that press. */
static int64_t close_rows(const system_t *s, int64_t m) {
  int64_t count = 0;
  for (int64_t i = 0; i < m; i++) {
    const row_t *r = s->row + i;
    const size_t c = (size_t)s->touching[i];
    const int32_t *nodes = s->quad + 4 * (size_t)s->facet[c];
    if (r->p == 0.0) {
      let_go(s, c);
      continue;
    }
    double *slip = s->slip + 3 * c, *t = s->tangential_force + 3 * c, w[3];
    if (!(s->normal_force[c] > 0.0)) { /* born: the motion that led here */
      relative(s->xv, s->mass, nodes, s->xv + 6 * c, s->xi + 2 * c, s->dt, w, s->slip + 3 * c);
      part(w, r->n, s->kick, s->approach + c, slip);
    }
    lose(s->normal_force[c], r->p, t, r->t, s->approach[c], slip, s->total);
    memcpy(t, r->t, sizeof r->t);
    s->normal_force[c] = r->p;
    s->stiffness[c] = r->inverse / (s->dt * s->dt);
    given(r, s->dv, c, nodes, w);
    for (int a = 0; a < 3; a++)
      w[a] += r->w[a];
    part(w, r->n, s->dt, s->approach + c, slip);
    s->touching[count++] = (int32_t)c;
    act(c, s->xv, s->mass, s->dof, nodes, s->xi + 2 * c, r->n, r->p, t, s->f, s->total);
  }
  return count;
}

int64_t wr_lagrange(int64_t k, const int32_t *item, double dt, double kick, double tolerance,
                    int64_t sweeps, double fade, const double *friction, const double *xv,
                    const double *ahead, const double *mass, const int32_t *dof,
                    const int32_t *quad, const int32_t *facet, const double *xi,
                    const double *normal, double *gap, double *stiffness, double *offset,
                    double *normal_force, double *approach, double *tangential_force, double *slip,
                    int32_t *touching, double *work, double *dv, double *f, double *total,
                    double *info) {
  const system_t s = {.dt = dt,
                      .kick = kick,
                      .fade = fade,
                      .friction = friction,
                      .xv = xv,
                      .ahead = ahead,
                      .mass = mass,
                      .xi = xi,
                      .normal = normal,
                      .dof = dof,
                      .quad = quad,
                      .facet = facet,
                      .gap = gap,
                      .stiffness = stiffness,
                      .offset = offset,
                      .normal_force = normal_force,
                      .approach = approach,
                      .tangential_force = tangential_force,
                      .slip = slip,
                      .dv = dv,
                      .f = f,
                      .total = total,
                      .row = (row_t *)work,
                      .touching = touching};
  double deep;
  total[2] = total[3] = 0.0;
  for (int a = 5; a < 12; a++)
    total[a] = 0.0;
  const int64_t m = open_rows(&s, k, item, &deep);
  for (int64_t i = 0; i < m; i++) {
    const row_t *r = s.row + i;
    const size_t c = (size_t)touching[i];
    double impulse[3];
    for (int a = 0; a < 3; a++)
      impulse[a] = kick * (r->p * r->n[a] + r->t[a]);
    push(r, dv, c, quad + 4 * (size_t)facet[c], impulse);
  }
  info[0] = info[1] = 0.0;
  for (int64_t it = 0; m && it < sweeps; it++) {
    info[0] = (double)(it + 1);
    info[1] = sweep(m, s.row, touching, dt, kick, quad, facet, dv) / deep;
    if (!(info[1] > tolerance))
      break;
  }
  return close_rows(&s, m);
}
