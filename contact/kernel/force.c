/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Forces of penalty springs with friction, and how they act on both bodies. */
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
 * depend on where the node lands; `crowd` contactor nodes share the mass of one target node.
 * `shared` is the area that both sides bring. */
static double effective_mass(const double *mass, const double *area, const int32_t *quad,
                             const double *xi, size_t c, double *shared) {
  double N[4], inverse = 0.0, tributary = 0.0;
  shape4(xi, N);
  for (int i = 0; i < 4; i++) {
    inverse += N[i] / mass[quad[i]];
    tributary += N[i] * area[quad[i]];
  }
  *shared = fmin(area[c], tributary);
  return 1.0 / (1.0 / mass[c] + inverse * fmax(1.0, tributary / area[c]));
}

int64_t wr_normal(int64_t k, const int32_t *item, double dt, double per_mass, double per_area,
                  double fraction, double ratio, double fade, const double *foundation_c,
                  const double *foundation_t, const double *xv, const double *mass,
                  const double *area, const int32_t *quad, const int32_t *facet, const double *xi,
                  const double *normal, double *gap, double *stiffness, double *damper,
                  double *offset, double *normal_force, double *damping_force,
                  double *tangential_force, double *slip, int32_t *touching, double *total) {
  int64_t count = 0;
  for (int a = 2; a < 12; a++)
    total[a] = 0.0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)item[i];
    double *t = tangential_force + 3 * c, *s = slip + 3 * c, w[3], spin[3];
    if (gap[c] >= 0.0)
      offset[c] = 0.0;
    total[4] = fmax(total[4], -gap[c]);
    gap[c] += fade * offset[c];
    if (gap[c] >= 0.0) { /* NaN stays in contact, so that the guards see it */
      if (stiffness[c] > 0.0)
        total[0] += 0.5 * dot3(t, t) / (ratio * stiffness[c]);
      stiffness[c] = normal_force[c] = damping_force[c] = 0.0;
      t[0] = t[1] = t[2] = s[0] = s[1] = s[2] = 0.0;
      continue;
    }
    const double *n = normal + 3 * c, *p = xv + 6 * c;
    const int32_t *nodes = quad + 4 * (size_t)facet[c];
    touching[count++] = (int32_t)c;
    relative(xv, mass, nodes, p, xi + 2 * c, dt, w, spin);
    const double closing = -dot3(w, n);
    const int born = stiffness[c] == 0.0;
    if (born) {
      double shared;
      const double m = effective_mass(mass, area, nodes, xi + 2 * c, c, &shared);
      stiffness[c] = foundation_c
                         ? per_area * shared * fmin(foundation_c[c], foundation_t[facet[c]])
                         : per_mass * m;
      damper[c] = 2.0 * fraction * sqrt(stiffness[c] * m);
    }
    carry(spin, dt, n, t);
    for (int a = 0; a < 3; a++)
      s[a] = born ? 0.0 : dt * (w[a] + closing * n[a]);
    /* penalty spring and dashpot, never tension; no dashpot in statics */
    const double spring = -stiffness[c] * gap[c], push = dt > 0.0 ? damper[c] * closing : 0.0;
    const double old = damping_force[c];
    normal_force[c] = push < -spring ? 0.0 : spring + push;
    damping_force[c] = normal_force[c] - spring;
    total[1] +=
        0.5 * (old + damping_force[c]) * closing * dt; /* trapezoidal, as the leapfrog's work */
  }
  return count;
}

/* Radial return of the trial force; returns 1 for stick. */
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

/* Adds the force of one contact to both bodies on owned dofs, and to the resultants. */
static void act(size_t c, const double *xv, const double *mass, const int32_t *dof,
                const int32_t *nodes, const double *xi, const double *n, double normal_force,
                const double *t, double *f, double *total) {
  double N[4], r[3], R[4][3], inverse[6], F[3], M[3], A[3], extra[3] = {0, 0, 0};
  for (int a = 0; a < 3; a++) {
    F[a] = normal_force * n[a] + t[a];
    total[6 + a] += normal_force * n[a];
    total[9 + a] += t[a];
  }
  total[5] += normal_force;
  if (dof[c] >= 0)
    for (int a = 0; a < 3; a++)
      f[3 * (size_t)dof[c] + a] += F[a];
  if (!lever(xv, mass, nodes, xv + 6 * c, xi, 0.0, N, r, R, inverse))
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

int64_t wr_friction(int64_t k, const int32_t *touching, double ratio, const double *friction,
                    const double *xv, const double *mass, const int32_t *dof, const int32_t *quad,
                    const int32_t *facet, const double *xi, const double *gap, const double *normal,
                    const double *stiffness, const double *normal_force, const double *slip,
                    double *tangential_force, double *f, double *total) {
  int64_t sticking = 0;
  for (int64_t i = 0; i < k; i++) {
    const size_t c = (size_t)touching[i];
    sticking += return_map(ratio * stiffness[c], friction[c] * normal_force[c], slip + 3 * c,
                           tangential_force + 3 * c, total);
    total[2] += 0.5 * stiffness[c] * gap[c] * gap[c];
    act(c, xv, mass, dof, quad + 4 * (size_t)facet[c], xi + 2 * c, normal + 3 * c, normal_force[c],
        tangential_force + 3 * c, f, total);
  }
  return sticking;
}
