/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Forces at t that depend on the gaps at t + dt: forward-increment Lagrange multipliers (Carpenter,
 * Taylor, Katona, Int. J. Numer. Meth. Eng. 32, 103-128, 1991), and springs taken implicitly, which
 * add their give to the diagonal of the same system. */

void wr_predict(const wr_pass *pass, int64_t k, const int32_t *item, double dt, double kick,
                const double *f, double *ahead) {
  const int32_t *dof = pass->dof;
  for (int64_t i = 0; i < k; i++) {
    const size_t j = (size_t)item[i];
    const double *x = pass->xv + 6 * j;
    const double s = dof[j] >= 0 ? kick / pass->mass[j] : 0.0;
    for (int a = 0; a < 3; a++) {
      const double v = x[a + 3] + (dof[j] >= 0 ? s * f[3 * (size_t)dof[j] + a] : 0.0);
      ahead[6 * j + a + 3] = v;
      ahead[6 * j + a] = x[a] + dt * v;
    }
  }
}

/* Gap at the closest point that the node has. */
static double gap_there(const wr_pass *pass, const wr_state *h, size_t c) {
  const double *x = pass->xv + 6 * c;
  double y[3][3], d[3][3], m[4][3], r[3];
  patch_t s;
  if (pass->target->corner) {
    patch_of(pass->target, pass->xv, h->facet[c], &s);
    curved(&s, h->xi + 2 * c, y, d);
    for (int a = 0; a < 3; a++)
      r[a] = x[a] - y[0][a];
  } else {
    monomials(pass->xv, facet_of(pass, h, c), m);
    residual(m, x, h->xi + 2 * c, r, y[1], y[2]);
  }
  return dot3(r, h->normal + 3 * c) - (pass->points ? pass->points->height[c] : 0.0);
}

/* Counts the work of a node's forces over half a step of relative velocity w; returns w . n. */
static double count_work(const wr_state *h, size_t c, double dt, const double *w) {
  wr_totals *total = h->totals;
  const double along = dot3(w, h->normal + 3 * c);
  total->damping_dissipation -= 0.5 * dt * h->normal_force[c] * along;
  total->friction_dissipation -= 0.5 * dt * dot3(h->tangential_force + 3 * c, w);
  return along;
}

void wr_settle(const wr_pass *pass, wr_state *h, int64_t k, double dt) {
  h->totals->max_penetration = 0.0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)h->touching[i];
    double w[3], spin[3];
    relative(pass, h, c, dt, w, spin); /* on the positions at which the forces have acted */
    const double along = count_work(h, c, dt, w);
    for (size_t a = 0; a < 3; a++)
      h->slip[3 * c + a] = dt * (w[a] - along * h->normal[3 * c + a]);
    h->totals->max_penetration = fmax(h->totals->max_penetration, -gap_there(pass, h, c));
  }
}

/* Velocity of the node relative to the facet that the contact forces have given so far. */
static inline void given(const wr_pass *pass, const wr_row *r, const double *dv, size_t c,
                         const int32_t *nodes, double *w) {
  const double *a = dv + 3 * (size_t)nodes[0], *b = dv + 3 * (size_t)nodes[1];
  const double *d = dv + 3 * (size_t)nodes[2], *e = dv + 3 * (size_t)nodes[3];
  const wr_points *points = pass->points;
  for (int i = 0; i < 3; i++)
    w[i] = (points ? 0.0 : dv[3 * c + (size_t)i]) -
           ((r->N[0] * a[i] + r->N[1] * b[i]) + (r->N[2] * d[i] + r->N[3] * e[i]));
  if (points)
    carried(points, c, dv, w);
}

/* Adds the velocities of an impulse on the node and against the facet. */
static inline void push(const wr_pass *pass, const wr_row *r, double *dv, size_t c,
                        const int32_t *nodes, const double *impulse) {
  const wr_points *points = pass->points;
  for (int i = 0; i < 3 && !points; i++)
    dv[3 * c + (size_t)i] += r->per_mass[0] * impulse[i];
  if (points)
    spread(points, c, impulse, dv);
  for (int b = 0; b < 4; b++) {
    const double s = r->N[b] * r->per_mass[b + 1];
    for (int i = 0; i < 3; i++)
      dv[3 * (size_t)nodes[b] + (size_t)i] -= s * impulse[i];
  }
}

/* What the steps of wr_implicit share; see kernel.h. */
typedef struct {
  const wr_pass *pass;
  wr_state *state;
  wr_solver *solver;
  double dt, kick, fade, *f;
} system_t;

/* Sets up the row of one contact, with the forces of the last step as the first guess. The spin of
 * the facet is that of the last step: without contact its nodes would fly apart. */
static void open_row(const system_t *s, size_t c, wr_row *r) {
  const wr_state *h = s->state;
  const double *xv = s->pass->xv, *ahead = s->solver->ahead, *mass = s->pass->mass;
  const int32_t *nodes = facet_of(s->pass, h, c);
  const wr_points *points = s->pass->points;
  double spin[3], W;
  shape4(h->xi + 2 * c, r->N);
  W = r->per_mass[0] = points ? point_mass(points, c, s->solver->dv) : 1.0 / mass[c];
  relative(s->pass, h, c, 0.5 * s->dt, r->w, spin);
  for (int a = 3; a < 6; a++)
    r->w[a - 3] += ahead[6 * c + (size_t)a] - xv[6 * c + (size_t)a];
  for (int b = 0; b < 4; b++) {
    const size_t j = 6 * (size_t)nodes[b];
    r->per_mass[b + 1] = 1.0 / mass[nodes[b]];
    W += r->N[b] * r->N[b] * r->per_mass[b + 1];
    for (size_t a = 3; a < 6; a++)
      r->w[a - 3] -= r->N[b] * (ahead[j + a] - xv[j + a]);
  }
  memcpy(r->n, h->normal + 3 * c, sizeof r->n);
  memcpy(r->t, h->tangential_force + 3 * c, sizeof r->t);
  carry(spin, s->dt, r->n, r->t);
  memcpy(r->held, r->t, sizeof r->held);
  r->gap = h->gap[c];
  r->p = h->normal_force[c];
  r->inverse = 1.0 / W;
  r->friction = h->friction[c];
  r->give[0] = r->give[1] = 0.0;
  if (!s->solver->springs)
    return;
  double m;
  if (!(h->stiffness[c] > 0.0))
    h->stiffness[c] = stiffness_at_birth(s->pass, h, c, &m);
  r->give[0] = 1.0 / (s->dt * h->stiffness[c]);
  r->give[1] = r->give[0] / s->pass->tangential;
}

/* One sweep of projected Gauss-Seidel; returns the largest move that it made [m]. */
static double sweep(const system_t *s, int64_t m) {
  const double dt = s->dt, kick = s->kick;
  double largest = 0.0, *dv = s->solver->dv;
  for (int64_t i = 0; i < m; i++) {
    wr_row *r = s->solver->row + i;
    const size_t c = (size_t)s->state->touching[i];
    const int32_t *nodes = facet_of(s->pass, s->state, c);
    double w[3], old[3], impulse[3], moved = 0.0;
    given(s->pass, r, dv, c, nodes, w);
    const double W = kick / r->inverse, before = r->p;
    const double p =
        before - (r->gap / dt + dot3(w, r->n) + before * r->give[0]) / (W + r->give[0]);
    r->p = p > 0.0 ? p : 0.0;
    memcpy(old, r->t, sizeof old);
    const double limit = r->friction * r->p;
    if (limit > 0.0) { /* the force of stick, returned to the cone */
      for (int a = 0; a < 3; a++)
        w[a] += r->w[a];
      const double along = dot3(w, r->n);
      for (int a = 0; a < 3; a++)
        r->t[a] -=
            (w[a] - along * r->n[a] + (r->t[a] - r->held[a]) * r->give[1]) / (W + r->give[1]);
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
    push(s->pass, r, dv, c, nodes, impulse);
    moved = dt * sqrt(moved) / r->inverse;
    if (moved > largest || isnan(moved))
      largest = moved;
  }
  return largest;
}

static void let_go(wr_state *h, size_t c) {
  h->stiffness[c] = h->normal_force[c] = 0.0;
  memset(h->tangential_force + 3 * c, 0, 3 * sizeof(double));
  memset(h->slip + 3 * c, 0, 3 * sizeof(double));
}

/* Opens a row for each node that overlaps, or that its neighbours may push so far; returns their
 * number and the deepest overlap. */
static int64_t open_rows(const system_t *s, const wr_candidates *near, double *deep) {
  wr_state *h = s->state;
  double *dv = s->solver->dv;
  int64_t m = 0;
  *deep = 0.0;
  for (int64_t i = 0; i < near->k; i++) {
    const size_t c = (size_t)near->item[i];
    if (h->gap[c] >= 0.0)
      h->offset[c] = 0.0;
    h->gap[c] += s->fade * h->offset[c];
    *deep = fmax(*deep, -h->gap[c]);
  }
  for (int64_t i = 0; i < near->k; i++) {
    const size_t c = (size_t)near->item[i];
    const int32_t *nodes = facet_of(s->pass, h, c);
    if (h->gap[c] >= *deep) {
      if (h->stiffness[c] > 0.0)
        let_go(h, c);
      continue;
    }
    open_row(s, c, s->solver->row + m);
    memset(dv + 3 * c, 0, 3 * sizeof *dv);
    for (int b = 0; b < 4; b++)
      memset(dv + 3 * (size_t)nodes[b], 0, 3 * sizeof *dv);
    h->touching[m++] = (int32_t)c;
  }
  return m;
}

/* Takes over the solution and applies its forces; returns the number of nodes that press. What the
 * first half of their work has not given to springs is lost. */
static int64_t close_rows(const system_t *s, int64_t m) {
  wr_state *h = s->state;
  wr_totals *total = h->totals;
  const double normal = total->normal_energy, tangential = total->tangential_energy;
  const int moving = s->kick == s->dt; /* else the first step: no first half but that of impacts */
  int64_t count = 0;
  begin_step(total);
  for (int64_t i = 0; i < m; i++) {
    const wr_row *r = s->solver->row + i;
    const size_t c = (size_t)h->touching[i];
    if (r->p == 0.0) {
      let_go(h, c);
      continue;
    }
    double w[3], spin[3];
    const int struck = !(h->normal_force[c] > 0.0);
    h->normal_force[c] = r->p;
    memcpy(h->tangential_force + 3 * c, r->t, sizeof r->t);
    h->gap[c] = -s->dt * r->give[0] * r->p; /* at t + dt, with the force */
    if (!s->solver->springs)
      h->stiffness[c] = r->inverse / (s->dt * s->dt);
    relative(s->pass, h, c, 0.0, w, spin);
    count_work(h, c, moving || struck ? s->kick : 0.0, w);
    total->normal_energy += 0.5 * s->dt * r->give[0] * r->p * r->p;
    total->tangential_energy += 0.5 * s->dt * r->give[1] * dot3(r->t, r->t);
    h->touching[count++] = (int32_t)c;
    act(s->pass, h, c, s->f);
  }
  total->damping_dissipation -= moving ? total->normal_energy - normal : 0.0;
  total->friction_dissipation -= moving ? total->tangential_energy - tangential : 0.0;
  return count;
}

int64_t wr_implicit(const wr_pass *pass, const wr_candidates *near, wr_state *state,
                    wr_solver *solver, double dt, double kick, double fade, double *f) {
  const system_t s = {pass, state, solver, dt, kick, fade, f};
  double deep;
  const int64_t m = open_rows(&s, near, &deep);
  for (int64_t i = 0; i < m; i++) {
    const wr_row *r = solver->row + i;
    const size_t c = (size_t)state->touching[i];
    double impulse[3];
    for (int a = 0; a < 3; a++)
      impulse[a] = kick * (r->p * r->n[a] + r->t[a]);
    push(pass, r, solver->dv, c, facet_of(pass, state, c), impulse);
  }
  solver->sweeps = 0;
  solver->residual = 0.0;
  while (m && solver->sweeps < solver->most) {
    solver->sweeps++;
    solver->residual = sweep(&s, m) / deep;
    if (!(solver->residual > solver->tolerance))
      break;
  }
  return close_rows(&s, m);
}
