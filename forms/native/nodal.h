/* SPDX-License-Identifier: LGPL-3.0-or-later */
/* Passes over nodes, one trip through memory each: declarations and comments only, cffi reads this
 * file. Vectors are flat, three components by node; matrices are row by row. */

/* From forces to accelerations: a *= per_mass; return how many of the n entries are not finite. */
int64_t nd_accelerate(int64_t n, const double *per_mass, double *a);

/* Kick and drift of n entries over a step, v += dt a, u += dt v, and a = load for the next. */
void nd_advance(int64_t n, double dt, const double *load, double *a, double *v, double *u);

/* Displacement of nodes in frames that have turned by R: r = R^T (X + u) - X. */
void nd_relative(int64_t n, const uint8_t *frame, /* [n]     of each node */
                 const double *turn,              /* [k][9]  rotation of each frame */
                 const double *place,             /* [n][3]  X                            m */
                 const double *displacement,      /* [n][3]  u                            m */
                 double *relative);               /* [n][3]  r                            m */

/* Velocity as such a frame sees it, its own rotation not taken off: w = R^T v. */
void nd_turned_back(int64_t n, const uint8_t *frame, const double *turn, const double *v,
                    double *w);

/* Turn the forces on nodes out of their frames and add them: force += R own; own is emptied. */
void nd_release(int64_t n, const uint8_t *frame, const double *turn, double *own, double *force);

/* Stretches by nodes or point masses: a sparse matrix B by rows, for all three directions alike. */
typedef struct {
  const int32_t *first; /* [n + 1]  first entry of each row */
  const int32_t *node;  /* [..]     node or point mass of each entry */
  const double *weight; /* [..] */
} nd_rows;

/* Springs and dampers on such stretches. */
typedef struct {
  int64_t n;     /*         rows */
  int64_t owned; /*         of them count here, the first ones */
  int32_t full;  /*         whether dampers are symmetric matrices */
  nd_rows on_nodes;
  nd_rows on_points;
  const double *stiffness; /* [n][3]                                   N/m */
  const double *damping;   /* [n][3] or [n][3][3]                      N s/m */
  double *pull;            /* [n][3]  of the dampers, at the last call N */
} nd_springs;

/* stretch = B motion, of nodes and point masses together; every `stride` numbers a row. */
void nd_stretch(const nd_springs *springs, const double *nodes, const double *points,
                int64_t stride, double *stretch);

/* force -= B^T (k e + c rate), and likewise the reaction on point masses; rows of `both` are e and
 * rate. Return the sum of (old + new pull of the dampers) . rate over owned rows. */
double nd_pull(const nd_springs *springs, const double *both, double *force, double *reaction);

/* values of springs on their point masses: out -= B^T values. */
void nd_onto_points(const nd_springs *springs, const double *values, double *out);

/* A torque on nodes about an axis through their centre of mass. */
typedef struct {
  int64_t k;
  const int32_t *node; /* [k]    */
  const double *mass;  /* [k]    kg */
  const double *place; /* [k][3] undeformed positions m */
  const double *axis;  /* [3]    unit vector */
  double *last;        /* [k][3] displacement at the last call m */
} nd_torque;

/* Sum of mass times position into moment[3], kg m. */
void nd_moment(const nd_torque *torque, const double *displacement, double *moment);

/* force += scale m (axis x r) with r from `centre`; return the sum of m (axis x r) . du since the
 * last call. */
double nd_turn(const nd_torque *torque, const double *centre, double scale,
               const double *displacement, double *force);

/* Mass that is carried along a rigid motion. */
typedef struct {
  int64_t k;
  const int32_t *node; /* [k]    */
  const double *mass;  /* [k]    kg */
  const double *place; /* [k][3] undeformed positions                m */
  double *last;        /* [k][3] displacement at the last call       m */
  double *before;      /* [k][3] force at the last call              N */
} nd_carried;

/* force += m w x (w x r) with r from `centre` and spin w; return the sum of (old + new force) . du
 * since the last call. */
double nd_carry(const nd_carried *carried, const double *centre, const double *spin,
                const double *displacement, double *force);
