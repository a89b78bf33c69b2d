/* SPDX-License-Identifier: LGPL-3.0-or-later */
#include <float.h>
#include <math.h>
#include <stdint.h>

#include "nodal.h"

int64_t nd_accelerate(int64_t n, const double *per_mass, double *a) {
  int64_t bad = 0;
  for (int64_t i = 0; i < n; ++i) {
    a[i] *= per_mass[i];
    bad += !(fabs(a[i]) <= DBL_MAX);
  }
  return bad;
}

void nd_advance(int64_t n, double dt, const double *load, double *restrict a, double *restrict v,
                double *restrict u) {
  for (int64_t i = 0; i < n; ++i) {
    v[i] += dt * a[i];
    u[i] += dt * v[i];
    a[i] = load[i];
  }
}

void nd_relative(int64_t n, const uint8_t *frame, const double *turn, const double *place,
                 const double *displacement, double *relative) {
  for (int64_t i = 0; i < n; ++i) {
    const double *R = turn + 9 * frame[i], *X = place + 3 * i, *u = displacement + 3 * i;
    const double x = X[0] + u[0], y = X[1] + u[1], z = X[2] + u[2];
    if (frame[i] == 0) { /* at rest: no digit is lost on the way through X */
      for (int c = 0; c < 3; ++c)
        relative[3 * i + c] = u[c];
      continue;
    }
    for (int c = 0; c < 3; ++c)
      relative[3 * i + c] = R[c] * x + R[3 + c] * y + R[6 + c] * z - X[c];
  }
}

void nd_turned_back(int64_t n, const uint8_t *frame, const double *turn, const double *v,
                    double *w) {
  for (int64_t i = 0; i < n; ++i) {
    const double *R = turn + 9 * frame[i], *a = v + 3 * i;
    for (int c = 0; c < 3; ++c)
      w[3 * i + c] = R[c] * a[0] + R[3 + c] * a[1] + R[6 + c] * a[2];
  }
}

void nd_release(int64_t n, const uint8_t *frame, const double *turn, double *own, double *force) {
  for (int64_t i = 0; i < n; ++i) {
    const double *R = turn + 9 * frame[i];
    double *f = own + 3 * i;
    for (int c = 0; c < 3; ++c)
      force[3 * i + c] += R[3 * c] * f[0] + R[3 * c + 1] * f[1] + R[3 * c + 2] * f[2];
    f[0] = f[1] = f[2] = 0;
  }
}

static void nd_multiply(const nd_rows *B, int64_t r, const double *motion, double *stretch) {
  for (int32_t e = B->first[r]; e < B->first[r + 1]; ++e)
    for (int c = 0; c < 3; ++c)
      stretch[c] += B->weight[e] * motion[3 * (int64_t)B->node[e] + c];
}

static void nd_transposed(const nd_rows *B, int64_t r, const double *pull, double *force) {
  for (int32_t e = B->first[r]; e < B->first[r + 1]; ++e)
    for (int c = 0; c < 3; ++c)
      force[3 * (int64_t)B->node[e] + c] -= B->weight[e] * pull[c];
}

void nd_stretch(const nd_springs *springs, const double *nodes, const double *points,
                int64_t stride, double *stretch) {
  for (int64_t r = 0; r < springs->n; ++r) {
    double *own = stretch + stride * r;
    own[0] = own[1] = own[2] = 0;
    nd_multiply(&springs->on_nodes, r, nodes, own);
    nd_multiply(&springs->on_points, r, points, own);
  }
}

double nd_pull(const nd_springs *springs, const double *both, double *force, double *reaction) {
  double work = 0;
  for (int64_t r = 0; r < springs->n; ++r) {
    const double *e = both + 6 * r, *rate = e + 3, *k = springs->stiffness + 3 * r;
    double *before = springs->pull + 3 * r, pull[3];
    for (int c = 0; c < 3; ++c) {
      const double *C = springs->damping + (springs->full ? 9 * r + 3 * c : 3 * r + c);
      const double now =
          springs->full ? C[0] * rate[0] + C[1] * rate[1] + C[2] * rate[2] : C[0] * rate[c];
      if (r < springs->owned)
        work += (before[c] + now) * rate[c];
      before[c] = now;
      pull[c] = k[c] * e[c] + now;
    }
    nd_transposed(&springs->on_nodes, r, pull, force);
    nd_transposed(&springs->on_points, r, pull, reaction);
  }
  return work;
}

void nd_onto_points(const nd_springs *springs, const double *values, double *out) {
  for (int64_t r = 0; r < springs->n; ++r)
    nd_transposed(&springs->on_points, r, values + 3 * r, out);
}

void nd_moment(const nd_torque *torque, const double *displacement, double *moment) {
  double sum[3] = {0, 0, 0};
  for (int64_t i = 0; i < torque->k; ++i) {
    const double *u = displacement + 3 * (int64_t)torque->node[i];
    for (int c = 0; c < 3; ++c)
      sum[c] += torque->mass[i] * (torque->place[3 * i + c] + u[c]);
  }
  for (int c = 0; c < 3; ++c)
    moment[c] = sum[c];
}

double nd_turn(const nd_torque *torque, const double *centre, double scale,
               const double *displacement, double *force) {
  const double *n = torque->axis;
  double work = 0;
  for (int64_t i = 0; i < torque->k; ++i) {
    const int64_t node = torque->node[i];
    const double *u = displacement + 3 * node;
    double *last = torque->last + 3 * i, *f = force + 3 * node, r[3];
    for (int c = 0; c < 3; ++c)
      r[c] = torque->mass[i] * (torque->place[3 * i + c] + u[c] - centre[c]);
    const double turn[3] = {n[1] * r[2] - n[2] * r[1], n[2] * r[0] - n[0] * r[2],
                            n[0] * r[1] - n[1] * r[0]};
    for (int c = 0; c < 3; ++c) {
      work += turn[c] * (u[c] - last[c]);
      last[c] = u[c];
      f[c] += scale * turn[c];
    }
  }
  return work;
}

double nd_carry(const nd_carried *carried, const double *centre, const double *spin,
                const double *displacement, double *force) {
  const double square = spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2];
  double work = 0;
  for (int64_t i = 0; i < carried->k; ++i) {
    const int64_t node = carried->node[i];
    const double *u = displacement + 3 * node;
    double *last = carried->last + 3 * i, *before = carried->before + 3 * i, r[3];
    for (int c = 0; c < 3; ++c)
      r[c] = carried->place[3 * i + c] + u[c] - centre[c];
    const double along = spin[0] * r[0] + spin[1] * r[1] + spin[2] * r[2];
    for (int c = 0; c < 3; ++c) {
      const double now = carried->mass[i] * (along * spin[c] - square * r[c]);
      work += (before[c] + now) * (u[c] - last[c]);
      last[c] = u[c];
      before[c] = now;
      force[3 * node + c] += now;
    }
  }
  return work;
}
