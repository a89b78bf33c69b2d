/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Forces of penalty springs with friction, and how they act on both bodies. */
/* Nodes of the facet that contactor node c touches. */
static inline const int32_t *facet_of(const wr_pass *p, const wr_state *h, size_t c) {
  return p->target->quad + 4 * (size_t)h->facet[c];
}

/* Shape functions, point, arm r (closest point to node) and, unless rigid, the facet's inverse
 * inertia (unit masses about the centroid, symmetric: xx yy zz yz xz xy). Returns 0 if rigid. */
static int lever(const wr_pass *p, const wr_state *h, size_t c, double back, double *N, double *r,
                 double R[4][3], double *inverse) {
  const double *xv = p->xv, *x = xv + 6 * c, *xi = h->xi + 2 * c;
  const int32_t *quad = facet_of(p, h, c);
  double m[3] = {0, 0, 0}, y[3] = {0, 0, 0}, J[6] = {0, 0, 0, 0, 0, 0};
  double s[3] = {x[0] - back * x[3], x[1] - back * x[4], x[2] - back * x[5]};
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
  if (isinf(p->mass[quad[0]]))
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
 * that `act` applies); `spin` is the facet's mean angular velocity. Both are taken on the
 * positions of a time `back` ago: half a step back, where the velocities live, rigid rotations of
 * any size give exactly zero. */
static void relative(const wr_pass *p, const wr_state *h, size_t c, double back, double *w,
                     double *spin) {
  const double *xv = p->xv;
  const int32_t *quad = facet_of(p, h, c);
  double N[4], r[3], R[4][3], inverse[6], L[3] = {0, 0, 0}, t[3];
  const int deformable = lever(p, h, c, back, N, r, R, inverse);
  memcpy(w, xv + 6 * c + 3, 3 * sizeof(double));
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
 * depend on where the node lands; `crowd` contactor nodes share the mass of one target node.
 * `shared` is the area that both sides bring. */
static double effective_mass(const wr_pass *p, const wr_state *h, size_t c, double *shared) {
  const int32_t *quad = facet_of(p, h, c);
  double N[4], inverse = 0.0, tributary = 0.0;
  shape4(h->xi + 2 * c, N);
  for (int i = 0; i < 4; i++) {
    inverse += N[i] / p->mass[quad[i]];
    tributary += N[i] * p->area[quad[i]];
  }
  *shared = fmin(p->area[c], tributary);
  return 1.0 / (1.0 / p->mass[c] + inverse * fmax(1.0, tributary / p->area[c]));
}

void wr_effective_mass(const wr_pass *pass, const wr_candidates *near, const wr_state *state,
                       double *mass, double *shared) {
  for (int64_t i = 0; i < near->k; i++)
    mass[i] = effective_mass(pass, state, (size_t)near->item[i], shared + i);
}

/* Sets the sums of the step to zero and leaves the accumulated ones and the penetration. */
static void begin_step(wr_totals *t) {
  *t = (wr_totals){.friction_dissipation = t->friction_dissipation,
                   .damping_dissipation = t->damping_dissipation,
                   .max_penetration = t->max_penetration};
}

/* Normal stiffness of a contact that begins; m is its effective mass. */
static double stiffness_at_birth(const wr_pass *p, const wr_state *h, size_t c, double *m) {
  double shared;
  *m = effective_mass(p, h, c, &shared);
  return p->foundation_c
             ? p->per_area * shared * fmin(p->foundation_c[c], p->foundation_t[h->facet[c]])
             : p->per_mass * *m;
}

static void give_birth(const wr_pass *p, wr_state *h, size_t c) {
  double m;
  h->stiffness[c] = stiffness_at_birth(p, h, c, &m);
  h->damper[c] = 2.0 * p->damping * sqrt(h->stiffness[c] * m);
}

int64_t wr_normal(const wr_pass *pass, const wr_candidates *near, wr_state *h, double dt,
                  double fade) {
  wr_totals *total = h->totals;
  int64_t count = 0;
  begin_step(total);
  total->max_penetration = 0.0;
  for (int64_t i = 0; i < near->k; i++) {
    const size_t c = (size_t)near->item[i];
    double *t = h->tangential_force + 3 * c, *s = h->slip + 3 * c, w[3], spin[3];
    if (h->gap[c] >= 0.0)
      h->offset[c] = 0.0;
    total->max_penetration = fmax(total->max_penetration, -h->gap[c]);
    const double gap = h->gap[c] += fade * h->offset[c];
    if (gap >= 0.0) { /* NaN stays in contact, so that the guards see it */
      if (h->stiffness[c] > 0.0)
        total->friction_dissipation += 0.5 * dot3(t, t) / (pass->tangential * h->stiffness[c]);
      h->stiffness[c] = h->normal_force[c] = h->damping_force[c] = 0.0;
      t[0] = t[1] = t[2] = s[0] = s[1] = s[2] = 0.0;
      continue;
    }
    const double *n = h->normal + 3 * c;
    h->touching[count++] = (int32_t)c;
    relative(pass, h, c, 0.5 * dt, w, spin);
    const double closing = -dot3(w, n);
    const int born = h->stiffness[c] == 0.0;
    if (born)
      give_birth(pass, h, c);
    carry(spin, dt, n, t);
    for (int a = 0; a < 3; a++)
      s[a] = born ? 0.0 : dt * (w[a] + closing * n[a]);
    /* penalty spring and dashpot, never tension; no dashpot in statics */
    const double spring = -h->stiffness[c] * gap, push = dt > 0.0 ? h->damper[c] * closing : 0.0;
    const double old = h->damping_force[c], force = push < -spring ? 0.0 : spring + push;
    h->normal_force[c] = force;
    h->damping_force[c] = force - spring;
    /* trapezoidal, as the leapfrog's work */
    total->damping_dissipation += 0.5 * (old + h->damping_force[c]) * closing * dt;
  }
  return count;
}

/* Radial return of the trial force; returns 1 for stick. */
static int return_map(double kt, double limit, const double *s, double *t, wr_totals *total) {
  double trial[3], old[3] = {t[0], t[1], t[2]};
  for (int a = 0; a < 3; a++)
    trial[a] = t[a] - kt * s[a];
  const double size = sqrt(dot3(trial, trial));
  const int stick = size <= limit;
  const double scale = stick ? 1.0 : limit / size;
  for (int a = 0; a < 3; a++) {
    t[a] = scale * trial[a];
    /* trapezoidal work of the plastic slip (trial - t) / kt: closes the leapfrog's balance */
    total->friction_dissipation += 0.5 * (old[a] + t[a]) * (trial[a] - t[a]) / kt;
  }
  total->tangential_energy += 0.5 * dot3(t, t) / kt;
  return stick;
}

/* Adds a force on contactor node c, or on the nodes of a point. */
static void load(const wr_pass *p, size_t c, const double *F, double *f) {
  const wr_points *points = p->points;
  const size_t each = points ? 4 : 1;
  for (size_t b = each * c; b < each * (c + 1); b++) {
    const int32_t dof = p->dof[points ? (size_t)points->node[b] : c];
    const double share = points ? points->weight[b] : 1.0;
    for (size_t a = 0; a < 3 && dof >= 0; a++)
      f[3 * (size_t)dof + a] += share * F[a];
  }
}

/* Adds the force of one contact to both bodies on owned dofs, and to the resultants. */
static void act(const wr_pass *p, const wr_state *h, size_t c, double *f) {
  const double *n = h->normal + 3 * c, *t = h->tangential_force + 3 * c;
  const double normal_force = h->normal_force[c];
  const int32_t *dof = p->dof, *nodes = facet_of(p, h, c);
  wr_totals *total = h->totals;
  double N[4], r[3], R[4][3], inverse[6], F[3], M[3], A[3], extra[3] = {0, 0, 0};
  for (int a = 0; a < 3; a++) {
    F[a] = normal_force * n[a] + t[a];
    total->normal_resultant[a] += normal_force * n[a];
    total->tangential_resultant[a] += t[a];
  }
  total->normal_force += normal_force;
  load(p, c, F, f);
  if (!lever(p, h, c, 0.0, N, r, R, inverse))
    return;
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

int64_t wr_friction(const wr_pass *pass, wr_state *h, int64_t k, const double *friction,
                    double *f) {
  int64_t sticking = 0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)h->touching[i];
    const double limit = friction ? friction[c] * h->normal_force[c] : 0.0;
    sticking += return_map(pass->tangential * h->stiffness[c], limit, h->slip + 3 * c,
                           h->tangential_force + 3 * c, h->totals);
    h->totals->normal_energy += 0.5 * h->stiffness[c] * h->gap[c] * h->gap[c];
    act(pass, h, c, f);
  }
  return sticking;
}
